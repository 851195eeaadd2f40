"""`edgemap record`: a camera's pictures into one MCAP file, to be looked at, replayed, and read by ROS 2."""

import shlex
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Annotated

from edgemap.cli.arguments import arg
from edgemap.cli.camera_options import read_intrinsics, read_mount
from edgemap.cli.groups import Source
from edgemap.cli.options import Topics, WithoutDepth, at_least, sensor_topics
from edgemap.cli.signals import stop_on_signals
from edgemap.geometry.errors import EdgemapError
from edgemap.runtime.frames.errors import BridgeError, UsageError
from edgemap.runtime.frames.reading import print_message


def command(
    out: Annotated[Path, arg(aliases=["-o"], metavar="FILE.mcap", help="The recording; must not exist yet.")],
    source: Annotated[Source, arg(name="Camera")],
    lossless: Annotated[bool, arg(help="PNG, not JPEG: a replay gives the very same map as the camera did.")] = False,
    frames: Annotated[int | None, arg(metavar="N", help="Stop after N pictures.")] = None,
    wheel: Annotated[
        str | None,
        arg(
            metavar="FILE.csv|.mcap",
            help="Wheel odometry to record beside them, by default the source's own: stamp_s,x_m,y_m,yaw_rad, or "
            "nav_msgs.",
        ),
    ] = None,
    realtime: Annotated[bool, arg(help="Pace files by their stamps, not at full speed.")] = False,
    without_depth: WithoutDepth = False,
    topics: Topics = None,
) -> None:
    """Record a camera: pictures, lens, mount and odometry as ROS 2 messages in one MCAP file.

    Ctrl-C ends it. `edgemap run --camera FILE.mcap` replays it; Foxglove and ROS 2 tools open it (docs/bags.md). A
    RealSense recording or another MCAP file as --camera is converted.
    """
    from edgemap.bridges.ros2.recordings.recorder import Recorder
    from edgemap.runtime.frames.camera import CameraOptions, next_frame
    from edgemap.runtime.inputs.cameras.kinds import read_wheels

    at_least(1, frames=frames)
    check_name(out)
    track = None if wheel is None else read_wheels(wheel)
    how = CameraOptions(realtime=realtime, topics=sensor_topics(topics), depth=not without_depth)
    with source.open(how) as camera:
        lens = read_intrinsics(source.intrinsics, *camera.info.size) or camera.info.intrinsics
        mount, wheels = read_mount(source.mount, camera.info.mount), track or camera.info.wheel
        info = replace(camera.info, intrinsics=lens, mount=mount, wheel=wheels, inference=None, calibration={})
        with stop_on_signals() as stop:
            recorder = Recorder(out, info, lossless=lossless)
            try:
                with closing(recorder):
                    while (frames is None or recorder.frames < frames) and not stop.is_set():
                        frame = next_frame(camera, print_message, stop.is_set)
                        if frame is None:
                            break
                        recorder.picture(frame)
            except EdgemapError as error:  # of a picture, or of the end of the file, as on a full disk
                error.args = (f"{error}; the pictures so far are in {out}",)
                raise
    if not recorder.frames:
        out.unlink()
        raise BridgeError(f"{out}: stopped before the first picture, so nothing is recorded")
    unknown = [name for name, known in (("lens", info.intrinsics), ("mount", info.mount)) if known is None]
    print(f"{recorder.frames} pictures, {out.stat().st_size / 1e6:.1f} MB in {out}")
    if unknown:
        print(f"(its {' and '.join(unknown)} not known: give them when it is replayed, or record with --camera-file)")
    print(f"see it:  edgemap run --camera {shlex.quote(str(out))}")


def check_name(path: Path | None) -> None:
    """Refuse, before anything is opened, a recording that is there or that `--camera` would not know again.

    Raises UsageError.
    """
    if path is not None and path.suffix != ".mcap":
        raise UsageError(f"{path}: a recording's name must end in .mcap")
    if path is not None and path.exists():
        raise UsageError(f"{path} exists already; choose another file")
