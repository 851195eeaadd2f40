"""`edgemap calibrate mount`: height, pitch and roll from a chessboard on the floor."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated

from edgemap.cli.arguments import arg
from edgemap.cli.calibrate_options import (
    BoardText,
    OutYaml,
    Pictures,
    check_out,
    known_lens,
    read_board,
    views_of,
    write_yaml,
)
from edgemap.cli.options import CameraFile, CameraSpec, IntrinsicsText, at_least, open_described


def command(
    camera: CameraSpec,
    square: Annotated[float, arg(metavar="METRES", help="Side of one square of the board.")],
    board: BoardText = "9x6",
    thickness: Annotated[float, arg(metavar="METRES", help="Of the board, added to the height.")] = 0.0,
    out: OutYaml = Path("camera.yaml"),
    frames: Pictures = None,
    camera_file: CameraFile = None,
    intrinsics: IntrinsicsText = None,
) -> None:
    """Measure how the camera sits, with a chessboard that lies flat on the floor in front of the robot.

    Take 3 or more pictures with the board on different places (or drive the robot round it). The lens must be known.
    The lever arm (forward_m, left_m) stays as the camera file has it: measure it with a ruler from the turn axis.
    """
    from dataclasses import replace

    from edgemap.runtime.calibration.floor_board import fit_mount

    at_least(1, frames=frames)
    chessboard = read_board(board, square)
    check_out(out, camera_file)
    with open_described(camera, camera_file) as source:
        lens = known_lens(source, intrinsics)
        fit = fit_mount(views_of(source, chessboard, frames), chessboard, lens, thickness)
        mount = fit.mount
        if source.mount is not None:
            mount = replace(mount, forward_m=source.mount.forward_m, left_m=source.mount.left_m)
    height_m, pitch_rad, roll_rad = fit.sigma
    print(f"{fit.views} views, {fit.rms_px:.3f} px off (root mean square), {fit.worst_view_px:.3f} px in the worst")
    print(f"  height {mount.height_m:7.4f} +- {height_m:.4f} m")
    print(f"  pitch  {math.degrees(mount.pitch_rad):7.3f} +- {math.degrees(pitch_rad):.3f} deg (positive down)")
    print(f"  roll   {math.degrees(mount.roll_rad):7.3f} +- {math.degrees(roll_rad):.3f} deg")
    write_yaml(out, camera_file, lens, mount, "mount", fit.record())
