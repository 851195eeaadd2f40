"""Options that name a camera, its lens and its mount, and how their text is read. No heavy imports here."""

from dataclasses import replace
from functools import cache, partial
from math import radians
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from edgemap.cli.arguments import arg
from edgemap.geometry.errors import GeometryError
from edgemap.runtime.frames.errors import CameraError, UsageError
from edgemap.runtime.frames.limits import HIGHEST_M, LOWEST_M
from edgemap.runtime.frames.option_texts import numbers
from edgemap.runtime.frames.reading import print_message

if TYPE_CHECKING:
    from edgemap.geometry.camera.intrinsics import Intrinsics
    from edgemap.geometry.camera.mount import Mount
    from edgemap.runtime.frames.camera import Camera, CameraOptions

CameraSpec = Annotated[
    str,
    arg(
        metavar="SPEC",
        help="Where frames come from: demo; realsense[:SERIAL]; realsense:FILE.db3|.bag; a number or /dev/videoN; "
        "an rtsp:// or http(s):// stream; a video file; a folder of pictures; a recording FILE.mcap[#/topic]; "
        "a ROS 2 topic ros2:/camera/image_raw; sim:SEED (a rendered home); "
        "KIND:DIR with KIND kitti, tum, c2w, drive, euroc or locobot. "
        "`edgemap cameras` lists those that are here.",
    ),
]
MountText = Annotated[
    str | None,
    arg(
        metavar="HEIGHT_M[,PITCH_DEG]",
        help="How the camera sits: height of the lens above the floor in metres, and pitch in degrees, positive "
        "looking DOWN. Overrides the camera file; roll and lever arm stay as they are, and the pitch where it is left "
        "out. `run` guesses a pitch that nothing gives.",
    ),
]
IntrinsicsText = Annotated[
    str | None,
    arg(
        metavar="FX,FY,CX,CY",
        help="Focal lengths and principal point in pixels of the delivered picture, no distortion; overrides the "
        "source and the camera file.",
    ),
]
CameraFile = Annotated[
    Path | None,
    arg(
        metavar="camera.yaml",
        help="Lens and mount of the camera, for sources that do not know them; or a camera file of ROS, Kalibr, "
        "OpenCV, ORB-SLAM, COLMAP (cameras.txt) or nerfstudio (transforms.json), for the lens.",
    ),
]
Rotate = Annotated[
    Literal[0, 90, 180, 270],
    arg(
        help="Degrees by which the pictures are turned clockwise until they are upright, for a camera on its side or "
        "upside down. --mount, --intrinsics and a camera file are those of the upright pictures.",
    ),
]


def read_mount_numbers(text: str | None) -> tuple[float, float | None] | None:
    """Height in metres and pitch in degrees of `--mount`, None for a pitch that is left out. Raises UsageError."""
    from edgemap.geometry.camera.mount import Mount

    if text is None:
        return None
    height_m, *pitch = numbers(text, "--mount", "HEIGHT_M,PITCH_DEG" if "," in text else "HEIGHT_M")
    try:
        Mount.from_degrees(height_m, pitch[0] if pitch else 0.0)
    except GeometryError as error:
        raise UsageError(f"--mount {text!r}: {error}") from None
    if not LOWEST_M <= height_m <= HIGHEST_M:
        raise UsageError(
            f"--mount {text!r}: a lens {height_m:g} m above the floor, expected {LOWEST_M:g} to {HIGHEST_M:g} m "
            "(HEIGHT_M,PITCH_DEG: metres first)"
        )
    return height_m, pitch[0] if pitch else None


def read_mount(text: str | None, prior: "Mount | None" = None) -> "Mount | None":
    """Applies `--mount HEIGHT_M[,PITCH_DEG]` to a prior mount: what it does not name stays. Raises UsageError."""
    from edgemap.geometry.camera.mount import Mount

    stated = read_mount_numbers(text)
    if stated is None:
        return prior
    height_m, pitch_deg = stated
    if pitch_deg is not None:
        return replace(prior or Mount(height_m), height_m=height_m, pitch_rad=radians(pitch_deg))
    if prior is None:
        raise UsageError(f"--mount {text!r}: the pitch is missing: pass HEIGHT_M,PITCH_DEG, or a camera file with it")
    return replace(prior, height_m=height_m)


def read_numbers_of_lens(text: str | None) -> list[float] | None:
    """The four numbers of `--intrinsics FX,FY,CX,CY`. Raises UsageError."""
    return None if text is None else numbers(text, "--intrinsics", "FX,FY,CX,CY")


def read_intrinsics(text: str | None, width: int, height: int) -> "Intrinsics | None":
    """`--intrinsics FX,FY,CX,CY` of pictures of this size."""
    from edgemap.runtime.frames.program_camera import as_intrinsics

    values = read_numbers_of_lens(text)
    if values is None:
        return None
    try:
        return as_intrinsics(
            (values[0], values[1], values[2], values[3]), width, height, f"--intrinsics {text!r}", _warn
        )
    except CameraError as error:
        raise UsageError(str(error)) from None


@cache
def _warn(text: str) -> None:
    """Prints a line once: a command reads its options more than once."""
    print_message(text)


HOW_TO_MEASURE = (
    "measure the lens's height above the floor in metres, and its pitch in degrees (0 level, positive down; on a flat "
    "floor pitch = atan(height / distance) for the floor point in the picture's middle), then pass "
    "--mount HEIGHT_M,PITCH_DEG or --camera-file camera.yaml"
)


def open_described(spec: str, camera_file: Path | None, how: "CameraOptions | None" = None) -> "Camera":
    """Opens a camera, with the sensors on ROS 2 topics that are asked for. The lens and mount of a camera file override
    the source's own, and a webcam is asked for the lens's size."""
    from edgemap.bridges.ros2.cameras import add_sensors
    from edgemap.runtime.frames.camera import CameraOptions, SensorTopics
    from edgemap.runtime.inputs.cameras.kinds import file_kind
    from edgemap.runtime.inputs.drives.camera_yaml import read_camera_yaml
    from edgemap.runtime.inputs.open import open_camera

    how = how or CameraOptions()
    if camera_file is not None:
        described = read_camera_yaml(camera_file)
        how = replace(how, intrinsics=described.intrinsics, mount=described.mount)
    topics = SensorTopics() if file_kind(spec) else how.topics  # a recording has its own topics
    return open_camera(spec, how, partial(add_sensors, topics=topics))


def known_lens(camera: "Camera", intrinsics: str | None) -> "Intrinsics":
    """The lens by flag, camera file or source, in this order. Raises UsageError for none, or one of another size."""
    lens = read_intrinsics(intrinsics, *camera.info.size) or camera.info.intrinsics
    if lens is None:
        raise UsageError(
            f"{camera.info.name} does not know its lens: pass --intrinsics FX,FY,CX,CY (pixels) or "
            "--camera-file camera.yaml (edgemap run writes one with a guessed lens into its folder)"
        )
    if (lens.width, lens.height) != tuple(camera.info.size):
        size = f"{camera.info.size[0]}x{camera.info.size[1]}"
        raise UsageError(f"{camera.info.name} delivers {size} px, the lens given is for {lens.width}x{lens.height} px")
    if intrinsics is None and lens.doubt:
        _warn(f"the lens of {camera.info.name}: {lens.doubt}")
    return lens
