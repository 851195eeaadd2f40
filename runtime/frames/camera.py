"""The camera: a source of frames with its intrinsics; and the protocols of live devices and their drivers."""

import math
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple, Protocol, Self

import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.camera.imu import ImuSamples
from edgemap.geometry.camera.intrinsics import Intrinsics
from edgemap.geometry.camera.mount import Mount
from edgemap.geometry.errors import GeometryError
from edgemap.runtime.frames.errors import CameraError, CameraFault, CameraState, FrameTimeout
from edgemap.runtime.frames.faults import Fault, FaultKind
from edgemap.runtime.frames.frame import Frame
from edgemap.runtime.frames.inference import Inference
from edgemap.runtime.frames.reading import printable
from edgemap.runtime.frames.trajectory import AttitudeTrack, PoseTrack, Trajectory

DEFAULT_RATE_HZ = 10.0  # of pictures without stamps
NO_DEPTH = "none at the time of the picture"
_Depth = NDArray[np.float32] | str | None
DepthOf = _Depth | Callable[[Intrinsics | None], _Depth]  # of a `Picture`


@dataclass(frozen=True, slots=True, eq=False)
class CameraInfo:
    """What is constant of a camera while it is read.

    name: the SPEC it was opened from. size: (width, height) of its pictures, px. intrinsics, mount: None where unknown;
    intrinsics for another size of the same shape are scaled. live: true for devices that produce frames independently
    of `read`. rate_hz: nominal frame rate, None if unknown. frame_count: None for live sources. truth: the drive's
    poses from its start, None where unknown. attitudes: those of the lens with them, None where the poses are planar.
    wheel: wheel odometry that came with the pictures, recorded or live, None where there is none. imu: all inertial
    samples of a recording. inference: of the run that made this recording, None where there is none.
    edits: of that run, as lines of edits.jsonl. calibration: of a recording, how intrinsics and mount were determined,
    as in camera.yaml. notes: what was taken of the source and what was not, as lines. faults: of what was read before
    the first frame. tf: gives the base's poses by a recording's tf (`motion.given_poses.GivenPoses`) for `MAP,BASE` and
    a mount; None where there is none.
    """

    name: str
    size: tuple[int, int] = (0, 0)
    intrinsics: Intrinsics | None = None
    mount: Mount | None = None
    live: bool = False
    rate_hz: float | None = None
    frame_count: int | None = None
    truth: Trajectory | None = None
    attitudes: AttitudeTrack | None = None
    wheel: PoseTrack | None = None
    imu: ImuSamples | None = None
    inference: Inference | None = None
    edits: tuple[str, ...] = ()
    calibration: Mapping[str, Any] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    faults: tuple[Fault, ...] = ()
    tf: Callable[[str, Mount], Any] | None = None

    def __post_init__(self) -> None:
        lens, (width, height) = self.intrinsics, self.size if isinstance(self.size, tuple) else (0, 0)
        if isinstance(lens, Intrinsics) and (width, height) not in ((0, 0), (lens.width, lens.height)):
            with suppress(GeometryError):  # `Camera.frame` refuses those of another shape
                object.__setattr__(self, "intrinsics", lens.fitted(width, height))
                note = f"intrinsics of {lens.width}x{lens.height} px scaled to {width}x{height} px"
                object.__setattr__(self, "notes", (*self.notes, note))


class Camera:
    """A source of frames, open from construction until `close`; a context manager. A subclass adds `read`, which makes
    its frames with `frame`.
    """

    def __init__(self, info: CameraInfo) -> None:
        self._info = replace(info, name=printable(info.name))
        self._delivered, self._last_s = 0, -math.inf  # frames so far, and the stamp of the last
        self._with_imu = 0  # frames with samples
        self._depths: Counter[str] = Counter()  # pictures by why their depth is not used; by "" where it is

    @property
    def info(self) -> CameraInfo:
        """What is constant of it."""
        return self._info

    def update_info(self, **changes: Any) -> None:
        """Changes its constants, as a mount that was stated or corrected. changes: fields of `CameraInfo`."""
        self._info = replace(self._info, **changes)

    @property
    def state(self) -> CameraState:
        """running, degraded (no frames, being recovered) or lost. Files are always running."""
        return CameraState.RUNNING

    @property
    def clock_offset_s(self) -> float:
        """From the device's stamps to those of its frames, s: where the device's clock was set, theirs went on."""
        return 0.0

    def read(self) -> Frame | None:
        """The next frame; None at the end. Files: every frame, in order. Live: the newest frame not yet delivered.

        Raises CameraFault for a fault of the delivery, and FrameTimeout where a live or paced camera has no frame yet;
        reading may continue after both. Any other CameraError ends the source.
        """
        raise NotImplementedError

    def account(self) -> list[Fault]:
        """What the frames delivered so far did not use, one fault for each kind."""
        faults: list[Fault] = []
        if (imu := self.info.imu) is not None and 2 * self._with_imu < self._delivered and len(imu):
            spans = f"{imu.stamps_s[0]:.3f} to {imu.stamps_s[-1]:.3f} s, the pictures' end at {self._last_s:.3f} s"
            text = f"IMU: samples for {self._with_imu} of {self._delivered} pictures (its stamps: {spans})"
            faults.append(Fault(FaultKind.SAMPLES, text))
        if imu is not None and 0 < (zeros := int((~imu.accel_m_s2.any(axis=1)).sum())) < len(imu):
            faults.append(Fault(FaultKind.SAMPLES, f"IMU: {zeros} of {len(imu)} samples have no force, left out"))
        whole, used = self._depths.total(), self._depths[""]
        causes = [(why, count) for why, count in self._depths.most_common() if why not in ("", NO_DEPTH)]
        if not whole or (used and not causes):
            return faults
        why = "; ".join(f"{why} ({count})" for why, count in causes[:2]) if used else (*causes, (NO_DEPTH, 0))[0][0]
        return [*faults, Fault(FaultKind.DEPTH, f"depth: {used} of {whole} pictures usable: {why}")]

    def object_records(self) -> list[dict[str, Any]] | None:
        """The true objects, as in objects.json, visible in the frames delivered so far; None where unknown."""
        return None

    def close(self) -> None:
        """Release the device or file; may be called twice."""

    def frame(self, image: NDArray[np.uint8], stamp_s: float, name: str, depth: DepthOf = None) -> Frame:
        """The picture as the next delivered frame, with the samples of `info.imu` since the last. Raises CameraError
        where its size is not the lens's.

        depth: as of a `Picture`; of another size than its, it is left out.
        """
        height, width = image.shape[:2]
        lens, imu = self.info.intrinsics, self.info.imu
        if lens is not None and (width, height) != (lens.width, lens.height):
            raise CameraError(f"{name}: picture is {width}x{height}, the intrinsics are for {lens.width}x{lens.height}")
        samples = ImuSamples.none() if imu is None else imu.between(self._last_s, stamp_s)
        self._with_imu += len(samples) > 0
        if (depth := depth(lens) if callable(depth) else depth) is not None:
            if not isinstance(depth, str) and depth.shape != (height, width):
                depth = f"{depth.shape[1]}x{depth.shape[0]} px for pictures of {width}x{height} px"
            self._depths[depth if isinstance(depth, str) else ""] += 1
            depth = None if isinstance(depth, str) else depth
        frame = Frame(self._delivered, stamp_s, image, name, samples, depth)
        self._delivered, self._last_s = self._delivered + 1, stamp_s
        return frame

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()


class Picture(NamedTuple):
    """A picture of a device or a file. stamp_s: by its clock. image: BGR, (H, W, 3). depth: (H, W) metres of
    its pixels, 0 where unknown, or why there is none; None without a depth camera. Of files also: what gives either by
    the lens, None where that is unknown; name and search, as of a `Frame`."""

    stamp_s: float
    image: NDArray[np.uint8]
    depth: DepthOf = None
    name: str = ""
    search: bool = True


Pictures = Iterator[Picture | CameraFault]


class FileCamera(Camera):
    """A finite source. pictures: in order, with a fault in place of each that is skipped; what they raise ends it.
    release: frees what they come from; may be called twice."""

    def __init__(self, info: CameraInfo, pictures: Pictures, release: Callable[[], object] = lambda: None) -> None:
        super().__init__(info)
        self._pictures, self._release = pictures, release

    def read(self) -> Frame | None:
        """The next picture; None after the last. Raises CameraFault for one that is skipped, and CameraError where the
        source is damaged."""
        picture = next(self._pictures, None)
        if picture is None:
            return None
        if isinstance(picture, CameraFault):
            raise picture
        stamp_s, image, depth, name, search = picture
        return replace(self.frame(image, stamp_s, name, depth), search=search)

    def close(self) -> None:
        """Deliver nothing more."""
        self._pictures = iter(())
        self._release()


LEAST_SIDE_PX = 32  # of a picture: a box of 24 px is the smallest that counts


def check_size(camera: Camera) -> None:
    """Raises CameraError for pictures in which nothing can be seen."""
    width, height = camera.info.size
    if 0 < min(width, height) < LEAST_SIDE_PX:
        text = f"{camera.info.name}: pictures of {width}x{height} px, both sides must have {LEAST_SIDE_PX} px or more"
        raise CameraError(text)


class Device(Protocol):
    """An open camera. size: (width, height) in px. rate_hz: nominal, None where unknown."""

    size: tuple[int, int]
    intrinsics: Intrinsics | None
    rate_hz: float | None

    def grab(self) -> tuple[float, NDArray[np.uint8]] | Picture | None:
        """The next (stamp in s, BGR picture), or `Picture`, or None for "nothing yet", within a second or so.

        May raise anything: the supervisor treats it as a fault.
        """
        ...

    def close(self) -> None:
        """Release the hardware."""


class Driver(Protocol):
    """Opens one camera, repeatedly. name: the SPEC. A class that inherits it has neither a reset nor a watch, for
    cameras whose reads fail when they are gone."""

    name: str

    def open(self) -> Device:
        """Open the camera. Raises CameraError, or whatever its library raises, where that fails."""
        ...

    def reset(self) -> None:
        """Reset the hardware of a closed camera, where it can be reset."""

    def watch(self, changed: Callable[[bool], None]) -> None:
        """Have `changed(present)` called, from any thread, when the device is plugged in (True) or removed (False)."""


@dataclass(frozen=True, slots=True)
class SensorTopics:
    """Further ROS 2 topics of a camera: of the recording where that is one, else live. wheels: nav_msgs/Odometry. imu:
    sensor_msgs/Imu. depth: of the pictures' pixels, sensor_msgs/Image, or CompressedImage as compressedDepth. optical:
    the camera's frame in tf, where its messages do not name it."""

    wheels: str | None = None
    imu: str | None = None
    depth: str | None = None
    optical: str = "camera_optical_frame"


@dataclass(frozen=True, slots=True)
class RecoveryRule:
    """Timeouts and retries of a live camera's supervisor.

    first_frame_limit_s: maximum time before the first frame, because devices start slowly. After a reopening the limit
    is three times the stall limit, doubled with each reopening, and at most first_frame_limit_s. stall_limit_s: a frame
    is late after ten median frame intervals of the camera, and not before this time. A hardware reset precedes every
    second reopening, if the camera supports it. The wait before the second reopening is half a second, doubled each
    time, at most half a minute. restarts: budget of reopenings; half a minute of frames restores one. strict: a run
    ends at its first fault (a damaged picture, a late frame).
    """

    first_frame_limit_s: float = 10.0
    stall_limit_s: float = 1.0
    restarts: int = 20
    strict: bool = False


@dataclass(frozen=True, slots=True)
class CameraOptions:
    """How a source is opened. intrinsics, mount: stated by the user; they override the source's. realtime: pace a file
    source by its stamps. recovery: of live devices. topics: further sensors, on ROS 2 topics. depth: whether frames
    contain the source's depth. frames: length of a rendered drive. rotate: degrees by which pictures are turned
    clockwise: 0, 90, 180 or 270; intrinsics and mount are those of the turned ones.
    """

    intrinsics: Intrinsics | None = None
    mount: Mount | None = None
    realtime: bool = False
    recovery: RecoveryRule | None = None
    topics: SensorTopics = SensorTopics()
    depth: bool = True
    frames: int | None = None
    rotate: int = 0


def next_frame(
    camera: Camera, report: Callable[[CameraFault], None], stopped: Callable[[], bool] = lambda: False
) -> Frame | None:
    """The next frame; None at the end, or when `stopped` returns true while waiting. Reports the faults before it."""
    while not stopped():
        try:
            return camera.read()
        except CameraFault as fault:
            report(fault)
        except FrameTimeout:
            continue
    return None
