"""`edgemap calibrate tilt`: pitch and roll from the straight edges of a room, without any pattern."""

from dataclasses import replace
from typing import Annotated

from edgemap.cli.arguments import arg
from edgemap.cli.calibrate_options import MountCalibrationOptions, print_mount
from edgemap.cli.options import above_zero
from edgemap.runtime.frames.errors import UsageError


def command(
    calibration: Annotated[MountCalibrationOptions, arg(name="Camera")],
    height: Annotated[
        float | None, arg(metavar="METRES", help="Lens above the floor, by ruler; else the known mount's.")
    ] = None,
) -> None:
    """Measure pitch and roll in a room with walls, doors and shelves: their edges are vertical, or level.

    Uses up to 40 pictures spread over the source; drive or turn the robot so that it sees several walls. Height cannot
    be seen and stays as given. The lens must be known.
    """
    from edgemap.geometry.camera.mount import Mount

    calibration.check()
    above_zero(height=height)
    with calibration.open() as source:
        lens = calibration.lens(source)
        if height is None and source.info.mount is None:
            raise UsageError(f"{source.info.name} does not know its height above the floor: pass --height METRES")
        prior = source.info.mount or Mount(height or 1.0)
        fit = calibration.tilt(source, lens)
    mount = replace(prior, height_m=height or prior.height_m, pitch_rad=fit.pitch_rad, roll_rad=fit.roll_rad)
    print_mount(mount, 0.0, *fit.sigma)
    calibration.write(lens, mount, "tilt", fit.record())
