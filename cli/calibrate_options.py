"""Common parts of the calibrate commands: the board's options, and writing camera.yaml."""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from edgemap.cli.arguments import arg
from edgemap.cli.errors import OptionError

if TYPE_CHECKING:
    from edgemap.geometry.camera.intrinsics import Intrinsics
    from edgemap.geometry.camera.mount import Mount
    from edgemap.runtime.inputs.cameras.protocol import Camera
    from edgemap.runtime.step.calibration.board import Board, BoardView
    from edgemap.runtime.step.calibration.tilt import TiltFit

EDGES = 40  # pictures that edges are looked for in

BoardText = Annotated[
    str, arg(metavar="COLSxROWS", help="The chessboard's INNER corners: one less than its squares each way.")
]
Pictures = Annotated[int | None, arg(metavar="N", help="Look at N pictures and no more.")]
OutYaml = Annotated[
    Path,
    arg(aliases=["-o"], metavar="camera.yaml", help="File to write; one that is there must be the --camera-file."),
]


def read_board(text: str, square_m: float = 1.0) -> Board:
    """`--board 9x6`. Raises OptionError."""
    from edgemap.runtime.step.calibration.board import Board

    found = re.fullmatch(r"(\d{1,4})[x×](\d{1,4})", text.strip())
    if found is None:
        raise OptionError(f"--board {text!r}: expected COLSxROWS, like 9x6")
    return Board(int(found[1]), int(found[2]), square_m)


def views_of(source: Camera, board: Board, pictures: int | None) -> list[BoardView]:
    """Different views of the board, printed one by one; Ctrl-C ends the search with the views so far."""
    from edgemap.runtime.step.calibration.board import board_views
    from edgemap.runtime.step.loop import stop_on_signals

    views: list[BoardView] = []
    with stop_on_signals() as stop:
        for view in board_views(source, board, pictures, stop.is_set):
            views.append(view)
            if source.live:
                print(f"view {len(views)} of the board; Ctrl-C when it has been everywhere", flush=True)
    return views


def tilt_of(source: Camera, lens: Intrinsics, frames: int | None) -> TiltFit:
    """Pitch and roll by the edges in at most 40 pictures spread over the source; prints how well they agree. Raises
    CalibrationError."""
    from edgemap.runtime.motion.attitude.segments import find_segments
    from edgemap.runtime.step.calibration.board import frames_of
    from edgemap.runtime.step.calibration.tilt import fit_tilt
    from edgemap.runtime.step.loop import stop_on_signals

    count = min(frames or source.frame_count or 10 * EDGES, source.frame_count or 10 * EDGES)
    every = max(1, math.ceil(count / EDGES))
    with stop_on_signals() as stop:
        frames_seen = frames_of(source, count, stop.is_set)
        edges = [find_segments(frame.image, lens) for frame in frames_seen if frame.index % every == 0]
    fit = fit_tilt(edges)
    share = f"{100 * fit.share:.0f} % of all edges' length, {fit.rms_deg:.2f} deg off"
    print(f"{fit.pictures} pictures, {fit.vertical} vertical and {fit.level} level edges ({share})")
    return fit


def check_out(out: Path, camera_file: Path | None) -> None:
    """Refuse to write over a file that is not the one being completed. Raises OptionError."""
    if out.exists() and (camera_file is None or out.resolve() != camera_file.resolve()):
        raise OptionError(f"{out} exists already; choose another --out, or complete it: --camera-file {out}")


def write_yaml(
    out: Path, camera_file: Path | None, lens: Intrinsics, mount: Mount | None, part: str, record: dict[str, Any]
) -> None:
    """Writes the new calibration and keeps the camera file's rate, axis and other calibrations. Raises CameraError."""
    from edgemap.runtime.frames.errors import CameraError
    from edgemap.runtime.inputs.drives.camera_yaml import CameraFile, read_camera_yaml, write_camera_yaml

    existing = read_camera_yaml(camera_file) if camera_file else CameraFile(lens)
    calibration = existing.calibration | {part: record}
    try:
        write_camera_yaml(out, lens, mount, existing.rate_hz, existing.world_up or "z", calibration)
    except OSError as error:
        raise CameraError(f"{out}: cannot be written ({error.strerror})") from None
    print(f"written to {out}")
