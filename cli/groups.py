"""Groups of options that several commands share: each is a dataclass, has its own box in `--help`, and opens what its
options name. No heavy imports here.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Literal

from edgemap.cli.arguments import OptionError, arg
from edgemap.cli.camera_options import (
    CameraFile,
    CameraSpec,
    IntrinsicsText,
    MountText,
    Opening,
    lens_and_mount,
    open_described,
    read_mount_numbers,
    read_numbers_of_lens,
)
from edgemap.cli.options import (
    BundleName,
    Confidence,
    EngineName,
    LoopClosure,
    OdometrySpec,
    PrecisionName,
    Threads,
    WithoutImu,
    WithoutWheels,
    check_odometry,
    find_bundle,
    in_unit,
)

if TYPE_CHECKING:
    from edgemap.geometry.camera.floor import FloorCamera
    from edgemap.runtime.frames.decisions import Decisions
    from edgemap.runtime.inputs.cameras.protocol import Camera
    from edgemap.runtime.network.bundle import Bundle
    from edgemap.runtime.network.compute import Pace


@dataclass(frozen=True)
class Optics:
    """Mount and intrinsics."""

    mount: MountText = None
    intrinsics: IntrinsicsText = None
    camera_file: CameraFile = None

    def check(self) -> None:
        """Read the texts, before anything is opened. Raises OptionError."""
        read_mount_numbers(self.mount)
        read_numbers_of_lens(self.intrinsics)

    def floor_camera(self, source: "Camera") -> "FloorCamera":
        """Intrinsics and mount: flags before the camera file, that before the source's own. Raises OptionError."""
        from edgemap.geometry.camera.floor import FloorCamera
        from edgemap.geometry.errors import GeometryError

        lens, mount = lens_and_mount(source, self.intrinsics, self.mount)
        try:
            return FloorCamera(lens, mount)
        except GeometryError as error:
            if self.mount is None:
                raise
            raise OptionError(f"--mount {self.mount!r}: {error}") from None


@dataclass(frozen=True)
class _Spec:
    camera: CameraSpec = "demo"


@dataclass(frozen=True)
class Source(Optics, _Spec):
    """Source of the frames."""

    def open(self, how: Opening = Opening()) -> "Camera":  # noqa: B008
        """The camera, described by the camera file where there is one."""
        return open_described(self.camera, self.camera_file, how)


@dataclass(frozen=True)
class NetworkOptions:
    """The network and what runs it."""

    bundle: BundleName = None
    threads: Threads = None
    precision: PrecisionName = "default"
    engine: EngineName = "default"

    def load(self, *specs: str, pace: "Pace" = "files", recorded: "Decisions | None" = None) -> "Bundle":
        """The bundle for these sources; see `find_bundle`."""
        return find_bundle(
            self.bundle, self.threads, self.precision, *specs, pace=pace, engine=self.engine, recorded=recorded
        )


@dataclass(frozen=True)
class MotionOptions:
    """Source of the robot's motion."""

    odometry: OdometrySpec = "hybrid"
    without_wheels: WithoutWheels = False
    without_imu: WithoutImu = False

    def check(self) -> None:
        """Read the SPEC, before anything is opened. Raises OptionError."""
        check_odometry(self.odometry)


@dataclass(frozen=True)
class MappingOptions:
    """How detections become objects."""

    confidence: Confidence = None
    clustering: Annotated[
        Literal["default", "paper"],
        arg(help="default: association under both covariances; paper: single linkage per label at 1 m."),
    ] = "default"
    loop_closure: LoopClosure = True

    def check(self) -> None:
        """Raises OptionError for a score that none can have."""
        in_unit(confidence=self.confidence)
