"""What every camera is to the pipeline: a source of frames that knows its lens, and perhaps its mount."""

from pathlib import Path
from typing import Any, Protocol, Self, runtime_checkable

from edgemap.geometry.camera.intrinsics import Intrinsics
from edgemap.geometry.camera.mount import Mount
from edgemap.runtime.attitude.track import AttitudeTrack
from edgemap.runtime.cameras.fault import CameraState
from edgemap.runtime.frame import Frame
from edgemap.runtime.network import Decisions
from edgemap.runtime.trajectory import PoseTrack, Trajectory


@runtime_checkable
class Camera(Protocol):
    """A source of frames, open from construction until `close`; a context manager.

    name: the SPEC it was opened from. live: true for devices that run on whether we read or not.
    intrinsics, mount: None where the source does not know them. rate_hz: nominal frame rate, None if unknown.
    size: (width, height) of the pictures that it delivers, px. frame_count: None for live sources.
    truth: the drive's own poses from its start, None where unknown. attitudes: those of the lens with them, None where
    the poses are planar. wheel: wheel odometry that came with the pictures,
    a CSV, a recording or poses that come live, None where there is none. decisions: of the run that made this
    recording, None where there are none. edits: of that run, as lines of edits.jsonl.
    """

    name: str
    live: bool
    size: tuple[int, int]
    intrinsics: Intrinsics | None
    mount: Mount | None
    rate_hz: float | None
    frame_count: int | None
    truth: Trajectory | None
    attitudes: AttitudeTrack | None
    wheel: Path | PoseTrack | None
    decisions: Decisions | None
    edits: tuple[str, ...]

    @property
    def state(self) -> CameraState:
        """running, degraded (no frames, being recovered) or lost."""
        ...

    def read(self) -> Frame | None:
        """The next frame; None at the end. Files: every frame, in order. Live: the newest frame not yet delivered.

        Raises CameraFault in place of what was wrong with the delivery, and FrameTimeout where a live or paced
        camera has nothing yet: reading may go on. Any other CameraError is the end.
        """
        ...

    def object_records(self) -> list[dict[str, Any]] | None:
        """What stands there, as in objects.json, with what the frames delivered so far show; None where unknown."""
        ...

    def close(self) -> None:
        """Let go of the device or file; may be called twice."""
        ...

    def __enter__(self) -> Self: ...

    def __exit__(self, *exception: object) -> None: ...
