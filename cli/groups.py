"""Groups of options that several commands share: each is a dataclass, has its own box in `--help`, and opens what its
options name. No heavy imports here.
"""

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Annotated, Literal

from edgemap.cli.arguments import arg
from edgemap.cli.camera_options import (
    HOW_TO_MEASURE,
    CameraFile,
    CameraSpec,
    IntrinsicsText,
    MountText,
    Rotate,
    known_lens,
    open_described,
    read_mount,
    read_mount_numbers,
    read_numbers_of_lens,
)
from edgemap.cli.options import Confidence, WithoutImu, in_unit
from edgemap.geometry.errors import GeometryError
from edgemap.runtime.frames.errors import UsageError
from edgemap.runtime.frames.option_texts import Clustering

if TYPE_CHECKING:
    from edgemap.geometry.camera.floor import FloorCamera
    from edgemap.runtime.frames.camera import Camera, CameraOptions

ODOMETRIES = ("hybrid", "paper", "truth")


@dataclass(frozen=True)
class Optics:
    """Mount and intrinsics."""

    mount: MountText = None
    intrinsics: IntrinsicsText = None
    camera_file: CameraFile = None

    def check(self) -> None:
        """Read the texts, before anything is opened. Raises UsageError."""
        read_mount_numbers(self.mount)
        read_numbers_of_lens(self.intrinsics)

    def floor_camera(self, source: "Camera") -> "FloorCamera":
        """Intrinsics and mount: flags before the camera file, that before the source's own. Raises UsageError."""
        from edgemap.geometry.camera.floor import FloorCamera
        from edgemap.runtime.inputs.drives.drive import ridden

        lens = known_lens(source, self.intrinsics)
        mount = ridden(source.info.name.partition(":")[0], read_mount(self.mount, source.info.mount))
        if mount is None:
            raise UsageError(f"{source.info.name} does not know how it is mounted: {HOW_TO_MEASURE}")
        try:
            return FloorCamera(lens, mount)
        except GeometryError as error:
            if self.mount is None:
                raise
            raise UsageError(f"--mount {self.mount!r}: {error}") from None


@dataclass(frozen=True)
class _Spec:
    camera: CameraSpec = "demo"


@dataclass(frozen=True)
class Source(Optics, _Spec):
    """Source of the frames."""

    rotate: Rotate = 0

    def open(self, how: "CameraOptions | None" = None) -> "Camera":
        """The camera, described by the camera file where there is one."""
        from edgemap.runtime.frames.camera import CameraOptions

        return open_described(self.camera, self.camera_file, replace(how or CameraOptions(), rotate=self.rotate))


@dataclass(frozen=True)
class MotionOptions:
    """Source of the robot's motion."""

    odometry: Annotated[
        str,
        arg(
            metavar="SPEC",
            help="Where the robot's motion comes from: hybrid (pictures, and gyro and wheels where the source brings "
            "them); paper (the bundle's ConvLSTM head); truth (the drive's own poses); wheel:FILE.csv "
            "(stamp_s,x_m,y_m,yaw_rad) or wheel:FILE.mcap; FILE.tum (poses of another program); tf[:MAP,BASE] (a "
            "SLAM's in a bag's /tf, with its corrections). The camera's own motion judges wheels and poses.",
        ),
    ] = "hybrid"
    pose_frame: Annotated[
        Literal["base", "camera"] | None,
        arg(help="Whose poses FILE.tum holds: the base's, or the camera's optical axes; found out from its motion."),
    ] = None
    without_wheels: Annotated[bool, arg(help="Ignore the wheel odometry of the source.")] = False
    without_imu: WithoutImu = False

    def check(self) -> None:
        """Refuse a SPEC that names no odometry. Raises UsageError with the one that is meant."""
        from edgemap.runtime.motion.odometry_names import is_pose_file, is_tf

        spec = self.odometry
        if spec in ODOMETRIES or spec.startswith("wheel:") or is_pose_file(spec) or is_tf(spec):
            return
        from difflib import get_close_matches

        close = get_close_matches(self.odometry.casefold(), [*ODOMETRIES, "wheel"], 1, 0.6)
        meant = "wheel:FILE.csv" if close == ["wheel"] else next(iter(close), None)
        hint = f"did you mean {meant}? Known are" if meant else "expected"
        known = f"{', '.join(ODOMETRIES)}, wheel:FILE.csv|.mcap, FILE.tum or tf[:MAP,BASE]"
        raise UsageError(f"--odometry {self.odometry!r}: {hint} {known}")


@dataclass(frozen=True)
class MappingOptions:
    """How detections become objects."""

    confidence: Confidence = None
    clustering: Annotated[
        Clustering,
        arg(help="default: association under both covariances; paper: single linkage per label at 1 m."),
    ] = "default"
    loop_closure: Annotated[
        bool,
        arg(
            help="Leave the pose to odometry when objects are observed again. Always so where poses are given (truth, "
            "FILE.tum) and with --clustering paper."
        ),
    ] = True

    def check(self) -> None:
        """Raises UsageError for a score that none can have."""
        in_unit(confidence=self.confidence)
