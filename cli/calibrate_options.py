"""Common parts of the calibrate commands: the board's options, and writing camera.yaml."""

import math
import re
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from edgemap.cli.arguments import arg
from edgemap.cli.camera_options import CameraFile, CameraSpec, IntrinsicsText, known_lens, open_described
from edgemap.cli.options import at_least, sensor_topics
from edgemap.cli.signals import stop_on_signals
from edgemap.runtime.frames.errors import UsageError

if TYPE_CHECKING:
    from edgemap.calibrate.board import Board, BoardView
    from edgemap.calibrate.tilt import TiltFit
    from edgemap.geometry.camera.intrinsics import Intrinsics
    from edgemap.geometry.camera.mount import Mount
    from edgemap.runtime.frames.camera import Camera

EDGES = 40  # pictures that edges are looked for in

BoardText = Annotated[
    str, arg(metavar="COLSxROWS", help="The chessboard's INNER corners: one less than its squares each way.")
]


@dataclass(frozen=True)
class CalibrationOptions:
    """The camera, and the camera.yaml that describes it afterwards."""

    camera: CameraSpec
    out: Annotated[
        Path,
        arg(aliases=["-o"], metavar="camera.yaml", help="File to write; one that is there must be the --camera-file."),
    ] = Path("camera.yaml")
    frames: Annotated[int | None, arg(metavar="N", help="Look at N pictures and no more.")] = None
    camera_file: CameraFile = None

    def check(self) -> None:
        """Refuses to write over a file that is not the one being completed. Raises UsageError."""
        at_least(1, frames=self.frames)
        out, described = self.out, self.camera_file
        if out.exists() and (described is None or out.resolve() != described.resolve()):
            raise UsageError(f"{out} exists already; choose another --out, or complete it: --camera-file {out}")

    def open(self, topics: str | None = None) -> "Camera":
        """The camera, described by the camera file where there is one. topics: text of `--topics`."""
        from edgemap.runtime.frames.camera import CameraOptions

        return open_described(self.camera, self.camera_file, CameraOptions(topics=sensor_topics(topics)))

    def views(self, source: "Camera", board: "Board") -> "list[BoardView]":
        """Different views of the board, of a live camera printed one by one; Ctrl-C ends the search with those so
        far."""
        from edgemap.calibrate.board import board_views

        views: list[BoardView] = []
        print("searching for the board; Ctrl-C ends the search with the views so far", flush=True)
        with stop_on_signals() as stop:
            for view in board_views(source, board, self.frames, stop.is_set):
                views.append(view)
                if source.info.live:
                    print(f"view {len(views)} of the board; Ctrl-C when it has been everywhere", flush=True)
        return views

    def write(self, lens: "Intrinsics", mount: "Mount | None", part: str, record: dict[str, Any]) -> None:
        """Writes the new calibration and keeps the camera file's rate, axis and other calibrations. Raises
        CameraError, DiskError."""
        from edgemap.runtime.inputs.drives import camera_yaml

        described = self.camera_file
        existing = camera_yaml.read_camera_yaml(described) if described else camera_yaml.CameraFile(lens)
        calibration = existing.calibration | {part: record}
        file = replace(existing, intrinsics=lens, mount=mount, calibration=calibration)
        camera_yaml.write_camera_yaml(self.out, file)
        print(f"written to {self.out}")


@dataclass(frozen=True)
class MountCalibrationOptions(CalibrationOptions):
    """The camera, whose lens must be known, and the camera.yaml that describes it afterwards."""

    intrinsics: IntrinsicsText = None

    def lens(self, source: "Camera") -> "Intrinsics":
        """By flag, camera file or source. Raises UsageError."""
        return known_lens(source, self.intrinsics)

    def tilt(self, source: "Camera", lens: "Intrinsics") -> "TiltFit":
        """Pitch and roll by the edges in at most 40 pictures spread over the source; prints how well they agree. Raises
        CalibrationError."""
        from edgemap.calibrate.board import frames_of
        from edgemap.calibrate.tilt import fit_tilt
        from edgemap.runtime.motion.attitude.segments import find_segments

        count = min(self.frames or source.info.frame_count or 10 * EDGES, source.info.frame_count or 10 * EDGES)
        every = max(1, math.ceil(count / EDGES))
        with stop_on_signals() as stop:
            frames_seen = frames_of(source, count, stop.is_set)
            edges = [find_segments(frame.image, lens) for frame in frames_seen if frame.index % every == 0]
        fit = fit_tilt(edges)
        share = f"{100 * fit.share:.0f} % of all edges' length, {fit.rms_deg:.2f} deg off"
        print(f"{fit.pictures} pictures, {fit.vertical} vertical and {fit.level} level edges ({share})")
        return fit


def read_board(text: str, square_m: float = 1.0) -> "Board":
    """`--board 9x6`. Raises UsageError."""
    from edgemap.calibrate.board import Board

    match = re.fullmatch(r"(\d{1,4})[x×](\d{1,4})", text.strip())
    if match is None:
        raise UsageError(f"--board {text!r}: expected COLSxROWS, like 9x6")
    return Board(int(match[1]), int(match[2]), square_m)


def print_board_fit(record: dict[str, Any]) -> None:
    """How well views of a board fit, by their entry of camera.yaml."""
    rms_px, worst_px = record["rms_px"], record["worst_view_px"]
    print(f"{record['views']} views, {rms_px:.3f} px off (root mean square), {worst_px:.3f} px in the worst")


def print_mount(mount: "Mount", height_m: float, pitch_rad: float, roll_rad: float) -> None:
    """The result, with standard deviations of height, 0 for one that was given, pitch and roll."""
    given = f"+- {height_m:.4f} m" if height_m else "m as given"
    print(f"  height {mount.height_m:7.4f} {given}")
    print(f"  pitch  {math.degrees(mount.pitch_rad):7.3f} +- {math.degrees(pitch_rad):.3f} deg (positive down)")
    print(f"  roll   {math.degrees(mount.roll_rad):7.3f} +- {math.degrees(roll_rad):.3f} deg")
