"""`edgemap calibrate mount`: height, pitch and roll, with a chessboard on the floor or without any pattern."""

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Annotated, Any

from edgemap.cli.arguments import arg
from edgemap.cli.calibrate_options import BoardText, MountCalibrationOptions, print_board_fit, print_mount, read_board
from edgemap.cli.network_options import NetworkOptions
from edgemap.cli.options import Topics, above_zero
from edgemap.cli.signals import stop_on_signals
from edgemap.runtime.frames.errors import CalibrationError, UsageError

if TYPE_CHECKING:
    from edgemap.geometry.camera.intrinsics import Intrinsics
    from edgemap.geometry.camera.mount import Mount

PICTURES = 60  # with depth, or with samples of an IMU

Fit = tuple["Mount", dict[str, Any]]


def command(
    calibration: Annotated[MountCalibrationOptions, arg(name="Camera")],
    square: Annotated[
        float | None,
        arg(metavar="METRES", help="Side of one square of a board on the floor; without it no board is looked for."),
    ] = None,
    board: BoardText = "9x6",
    thickness: Annotated[float, arg(metavar="METRES", help="Of the board, added to the height.")] = 0.0,
    height: Annotated[
        float | None,
        arg(metavar="METRES", help="Lens above the floor, by ruler, for sources with neither depth nor wheels."),
    ] = None,
    topics: Topics = None,
) -> None:
    """Measure how the camera sits: height, pitch and roll.

    Without a pattern: from the floor in depth pictures where the source has them. Else pitch and roll from the room's
    edges, or from gravity where no edges are, and the height from wheel odometry that comes with the source, or as
    given. With --square: from a chessboard that lies on the floor, in 4 or more places. The lens must be known. The
    lever arm (forward_m, left_m) stays as the camera file has it: measure it with a ruler from the turn axis.
    """
    calibration.check()
    above_zero(height=height)
    if square is not None:
        lens, (mount, record) = _by_board(calibration, square, board, thickness)
    else:
        lens, (mount, record) = _by_room(calibration, height, topics)
    calibration.write(lens, mount, "mount", record)


def _by_board(
    calibration: MountCalibrationOptions, square: float, board: str, thickness: float
) -> "tuple[Intrinsics, Fit]":
    from edgemap.calibrate.floor_board import fit_mount

    chessboard = read_board(board, square)
    with calibration.open() as source:
        lens = calibration.lens(source)
        fit = fit_mount(calibration.views(source, chessboard), chessboard, lens, thickness)
        prior = source.info.mount
    print_board_fit(fit.record())
    print_mount(fit.mount, *fit.sigma)
    return lens, (_with_lever_arm(fit.mount, prior), fit.record())


def _by_room(
    calibration: MountCalibrationOptions, height: float | None, topics: str | None
) -> "tuple[Intrinsics, Fit]":
    from edgemap.calibrate.board import frames_of
    from edgemap.calibrate.floor_depth import gravity
    from edgemap.geometry.camera.imu import ImuSamples

    with calibration.open(topics) as source, stop_on_signals() as stop:
        lens, prior, rolls = calibration.lens(source), source.info.mount, source.info.wheel is not None
        frames = frames_of(source, calibration.frames or PICTURES, stop.is_set)
        measured = [(frame.imu, frame.depth) for frame in frames]
    up = gravity(ImuSamples.joined([samples for samples, _ in measured]))
    if depths := [depth for _, depth in measured if depth is not None]:
        from edgemap.calibrate.floor_depth import fit_floor_depth

        fit = fit_floor_depth(depths, lens, up)
        print(
            f"{fit.pictures} of {fit.examined} depth pictures show a floor, {100 * fit.share:.0f} % of the points lie "
            f"on it, {1000 * fit.rms_m:.1f} mm off (root mean square)"
        )
        print_mount(fit.mount, *fit.sigma)
        _compare_gravity(fit.mount, up)
        return lens, (_with_lever_arm(fit.mount, prior), fit.record())
    if height is None and not rolls:
        raise UsageError(
            f"{calibration.camera} has neither depth nor wheels to measure the height: pass --height METRES"
        )
    return lens, _by_edges(calibration, lens, prior, height, topics, up)


def _by_edges(
    calibration: MountCalibrationOptions, lens: "Intrinsics", prior: "Mount | None", height: float | None,
    topics: str | None, up: Any,
) -> Fit:  # fmt: skip
    from edgemap.calibrate.board import frames_of
    from edgemap.calibrate.wheel_height import fit_wheel_height
    from edgemap.geometry.camera.inertial import OFFSET_RAD
    from edgemap.geometry.camera.mount import Mount, pitch_roll

    try:
        with calibration.open() as source:
            fit = calibration.tilt(source, lens)
        angles, sigma, record = (fit.pitch_rad, fit.roll_rad), fit.sigma, fit.record()
    except CalibrationError as error:
        if up is None:
            raise
        print(f"no angles from edges ({error}); gravity's are taken, with the accelerometer's offset in them")
        angles, sigma = pitch_roll(up), (OFFSET_RAD, OFFSET_RAD)
        offset_deg = round(math.degrees(OFFSET_RAD), 4)
        record = {"method": "gravity", "sigma_pitch_deg": offset_deg, "sigma_roll_deg": offset_deg}
    tilted = _with_lever_arm(Mount(height or 1.0, *angles), prior)
    sigma_m = 0.0
    if height is None:
        with calibration.open(topics) as source, stop_on_signals() as stop:
            bundle = NetworkOptions().load(calibration.camera)
            if source.info.live and calibration.frames is None:
                print("drive straight on over free floor; Ctrl-C ends it", flush=True)
            frames = frames_of(source, calibration.frames, stop.is_set)
            rolled = fit_wheel_height(source, frames, bundle, lens, tilted)
        tilted, sigma_m = replace(tilted, height_m=rolled.height_m), rolled.sigma_m
        print(
            f"height by {rolled.windows} windows of wheel travel, {rolled.travelled_m:.1f} m, as sure as their radius"
        )
        record |= {"height": "wheels and floor", "sigma_height_m": round(sigma_m, 5)}
    print_mount(tilted, sigma_m, *sigma)
    _compare_gravity(tilted, up)
    return tilted, record


def _with_lever_arm(mount: "Mount", prior: "Mount | None") -> "Mount":
    return (
        mount
        if prior is None
        else replace(mount, forward_m=prior.forward_m, left_m=prior.left_m, platform=prior.platform)
    )


def _compare_gravity(mount: "Mount", up: Any) -> None:
    """What the accelerometer says beside the result. Raises CalibrationError where no offset explains it."""
    from edgemap.geometry.camera.inertial import OFFSET_RAD
    from edgemap.geometry.camera.mount import pitch_roll

    if up is None:
        return
    pitch, roll = (math.degrees(angle) for angle in pitch_roll(up))
    off = max(abs(pitch - math.degrees(mount.pitch_rad)), abs(roll - math.degrees(mount.roll_rad)))
    text = f"gravity says pitch {pitch:.2f} and roll {roll:.2f} deg, {off:.2f} deg from this"
    if off > 2.0 * math.degrees(OFFSET_RAD):
        raise CalibrationError(
            f"{text}, at most {2.0 * math.degrees(OFFSET_RAD):g} expected: no level floor was in view"
        )
    print(f"  {text} (an accelerometer's offset is up to 4 deg)")
