"""A data folder's `camera.yaml`: lens, mount, frame rate, and which way is up in the poses."""

import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
import numpy as np
import yaml
from msgspec import Meta
from scipy.spatial.transform import Rotation

from edgemap.geometry.camera.depth_camera import DepthCamera
from edgemap.geometry.camera.intrinsics import Distortion, Intrinsics
from edgemap.geometry.camera.mount import Mount, Platform
from edgemap.geometry.errors import GeometryError
from edgemap.runtime.frames.disk import write_atomically
from edgemap.runtime.frames.errors import CameraError
from edgemap.runtime.frames.reading import Coordinate, Name, Side, Strict, convert
from edgemap.runtime.frames.spatial_poses import poses_of
from edgemap.runtime.frames.trajectory import QUATERNION_TOLERANCE
from edgemap.runtime.frames.yaml_file import read_yaml
from edgemap.runtime.inputs.drives.lens_files import read_foreign_lens

UpAxis = Literal["x", "y", "z", "-x", "-y", "-z"]
Angle = Annotated[float, Meta(gt=-90.0, lt=90.0)]  # degrees
Arm = Annotated[float, Meta(ge=-100.0, le=100.0)]  # metres
Focal = Annotated[float, Meta(gt=0.0, le=1e6)]  # px
Rate = Annotated[float, Meta(gt=0.0, le=1e5)]  # Hz
Part = Annotated[float, Meta(ge=-1.1, le=1.1)]  # of a unit quaternion


@dataclass(frozen=True, slots=True)
class CameraFile:
    """The contents of a `camera.yaml`. world_up: the axis of the recorded poses that points up, e.g. `-y`; None where
    the file leaves it to the layout's own custom. rate_hz, mount: None where absent. calibration: for each calibrated
    part, the method and its accuracy, as text. depth: the camera of the depth pictures; None where they are registered
    to the pictures."""

    intrinsics: Intrinsics
    mount: Mount | None = None
    rate_hz: float | None = None
    world_up: str | None = None
    calibration: dict[str, Any] = field(default_factory=dict)
    depth: DepthCamera | None = None


class DistortionRecord(Strict):
    """As `geometry.camera.intrinsics.Distortion`."""

    model: Name = "none"
    coefficients: Annotated[tuple[Annotated[float, Meta(ge=-1e3, le=1e3)], ...], Meta(max_length=8)] = ()


class LensRecord(Strict):
    """As `geometry.camera.intrinsics.Intrinsics`, px."""

    width: Side
    height: Side
    fx: Focal
    fy: Focal
    cx: Coordinate
    cy: Coordinate
    distortion: DistortionRecord | None = None

    def intrinsics(self) -> Intrinsics:
        """The lens. Raises GeometryError."""
        distortion = self.distortion or DistortionRecord()
        lens = Distortion(distortion.model, distortion.coefficients)
        return Intrinsics(self.width, self.height, self.fx, self.fy, self.cx, self.cy, lens)


class _Mount(Strict):
    height_m: Annotated[float, Meta(gt=0.0, le=10.0)]  # 60 is in cm
    pitch_deg: Angle
    roll_deg: Angle = 0.0
    forward_m: Arm = 0.0
    left_m: Arm = 0.0
    platform: Platform = Platform.ROBOT


class _Depth(LensRecord):
    position_m: tuple[Arm, Arm, Arm] = (0.0, 0.0, 0.0)
    quaternion_xyzw: tuple[Part, Part, Part, Part] = (0.0, 0.0, 0.0, 1.0)

    def camera(self) -> DepthCamera:
        """The depth camera. Raises GeometryError."""
        quaternion = np.array(self.quaternion_xyzw)
        length = float(np.linalg.norm(quaternion))
        if abs(length - 1.0) > QUATERNION_TOLERANCE:
            raise GeometryError(f"depth: quaternion_xyzw has length {length:.4f}, expected 1")
        (pose,) = poses_of(np.array([self.position_m]), quaternion[None] / length)
        return DepthCamera(self.intrinsics(), pose[:3, :3], pose[:3, 3])


class _CameraYaml(LensRecord):
    fps: Rate | None = None
    world_up: UpAxis | None = None
    mount: _Mount | None = None
    calibration: dict[str, Any] | None = None
    depth: _Depth | None = None


def read_camera_yaml(path: Path) -> CameraFile:
    """Read and check a `camera.yaml`, or the lens in a camera file of another program (`lens_files`); unknown and
    missing fields are errors.

    Raises CameraError, one line with the path, for text that is not YAML, wrong fields, and impossible numbers.
    """
    if (lens := read_foreign_lens(path)) is not None:
        return CameraFile(lens)
    # Lax, because YAML 1.1 reads 1e-3 as text.
    record = convert(read_yaml(path, CameraError), _CameraYaml, path, CameraError, strict=False)
    try:
        intrinsics = record.intrinsics()
        mount = record.mount and Mount.from_degrees(**msgspec.structs.asdict(record.mount))
        depth = record.depth and record.depth.camera()
    except GeometryError as error:
        raise CameraError(f"{path}: {error}") from None
    return CameraFile(intrinsics, mount, record.fps, record.world_up, record.calibration or {}, depth)


def write_camera_yaml(path: Path, file: CameraFile) -> None:
    """Write a `camera.yaml` that `read_camera_yaml` reads back to the same numbers (angles to 1e-9 degrees); up is z
    where nothing else is stated.

    Raises DiskError where the folder does not take it.
    """
    tree, depth = _lens(file.intrinsics), file.depth
    if file.rate_hz is not None:
        tree["fps"] = float(file.rate_hz)
    tree["world_up"] = file.world_up or "z"
    if file.mount is not None:
        kind = file.mount.platform
        tree["mount"] = mount_fields(file.mount) | ({} if kind is Platform.ROBOT else {"platform": str(kind)})
    if depth is not None:
        tree["depth"] = _lens(depth.intrinsics) | {
            "position_m": depth.position_m.tolist(),
            "quaternion_xyzw": Rotation.from_matrix(depth.rotation).as_quat(canonical=True).tolist(),
        }
    if file.calibration:
        tree["calibration"] = file.calibration
    write_atomically(path, yaml.safe_dump(tree, sort_keys=False, default_flow_style=None))


def mount_fields(mount: Mount, digits: int = 9) -> dict[str, Any]:
    """Height and lever arm, metres, and angles, degrees to so many digits, by their names in files."""
    angles = {"pitch_deg": mount.pitch_rad, "roll_deg": mount.roll_rad}
    lengths = {"forward_m": float(mount.forward_m), "left_m": float(mount.left_m)}
    degrees = {name: round(math.degrees(angle), digits) for name, angle in angles.items()}
    return {"height_m": float(mount.height_m), **degrees, **lengths}


def _lens(lens: Intrinsics) -> dict[str, Any]:
    tree: dict[str, Any] = {"width": lens.width, "height": lens.height}
    tree |= {name: float(getattr(lens, name)) for name in ("fx", "fy", "cx", "cy")}
    tree["distortion"] = {"model": lens.distortion.model, "coefficients": list(lens.distortion.coefficients)}
    return tree
