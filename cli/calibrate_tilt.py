"""`edgemap calibrate tilt`: pitch and roll from the straight edges of a room, without any pattern."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated

from edgemap.cli.arguments import arg
from edgemap.cli.calibrate_options import OutYaml, Pictures, check_out, tilt_of, write_yaml
from edgemap.cli.camera_options import CameraFile, CameraSpec, IntrinsicsText, known_lens, open_described
from edgemap.cli.errors import OptionError
from edgemap.cli.options import at_least


def command(
    camera: CameraSpec,
    height: Annotated[
        float | None, arg(metavar="METRES", help="Lens above the floor, by ruler; else the known mount's.")
    ] = None,
    out: OutYaml = Path("camera.yaml"),
    frames: Pictures = None,
    camera_file: CameraFile = None,
    intrinsics: IntrinsicsText = None,
) -> None:
    """Measure pitch and roll in a room with walls, doors and shelves: their edges are vertical, or level.

    Uses up to 40 pictures spread over the source; drive or turn the robot so that it sees several walls. Height cannot
    be seen and stays as given. The lens must be known.
    """
    from dataclasses import replace

    from edgemap.geometry.camera.mount import Mount

    at_least(1, frames=frames)
    check_out(out, camera_file)
    with open_described(camera, camera_file) as source:
        lens = known_lens(source, intrinsics)
        if height is None and source.mount is None:
            raise OptionError(f"{source.name} does not know its height above the floor: pass --height METRES")
        prior = source.mount or Mount(height or 1.0)
        fit = tilt_of(source, lens, frames)
    mount = replace(prior, height_m=height or prior.height_m, pitch_rad=fit.pitch_rad, roll_rad=fit.roll_rad)
    print(f"  pitch {math.degrees(fit.pitch_rad):7.3f} +- {math.degrees(fit.sigma[0]):.3f} deg (positive down)")
    print(f"  roll  {math.degrees(fit.roll_rad):7.3f} +- {math.degrees(fit.sigma[1]):.3f} deg")
    print(f"  height {mount.height_m:.3f} m as given")
    write_yaml(out, camera_file, lens, mount, "tilt", fit.record())
