"""A camera, the front end and the back end as one object, to iterate over or to push pictures to."""

from collections.abc import Callable, Generator, Sequence
from inspect import GEN_CLOSED, getgeneratorstate
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.camera.imu import ImuSamples
from edgemap.geometry.objects.scale import scaled_map
from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.camera import Camera
from edgemap.runtime.frames.errors import CameraError
from edgemap.runtime.frames.program_camera import PushedCamera
from edgemap.runtime.inputs.cameras.wrappers import SearchRate
from edgemap.runtime.outputs.map_objects import MapObjects
from edgemap.runtime.outputs.verdict.run_counts import RunCounts
from edgemap.runtime.outputs.verdict.verdict import Verdict
from edgemap.runtime.step.loop import steps
from edgemap.runtime.step.map_file import save_map
from edgemap.runtime.step.sinks import Sink
from edgemap.runtime.step.slam import SemanticSlam, StepResult


class Session:
    """Iterate for one `StepResult` a frame, or push pictures; `map` is the map so far. A context manager.

    The loop is that of `edgemap run`: a camera fault does not end it (strict: it is raised) and is in the `faults` of
    the next result. While a live camera is away, wheels and gyro update the pose, and `camera.state` reports it. A
    loop that was left can be resumed. sinks: where results go as well; they are closed with the last frame.
    """

    def __init__(
        self,
        camera: Camera,
        slam: SemanticSlam | Callable[[Camera], SemanticSlam],
        sinks: Sequence[Sink] = (),
        strict: bool = False,
        counts: RunCounts | None = None,
        rate_hz: float | None = None,
    ) -> None:
        """slam: front end and back end, or what makes them once the first pushed picture is there. counts: the sink
        that judges the map. rate_hz: pictures a second that are searched, all for None."""
        self.camera, self._rate_hz = camera, rate_hz
        self._counts = counts or RunCounts({})
        self._slam, self._sinks, self._strict = slam, (self._counts, *sinks), strict
        self._steps: Generator[StepResult, None, None] | None = None

    @property
    def slam(self) -> SemanticSlam:
        """Front end and back end. Raises CameraError before the first pushed picture."""
        if not isinstance(self._slam, SemanticSlam):
            raise CameraError("no picture has been pushed yet")
        return self._slam

    def push(
        self,
        image: NDArray[np.uint8],
        stamp_s: float,
        *,
        imu: ImuSamples | NDArray[np.float64] | None = None,
        wheels: SE2 | tuple[float, float, float] | None = None,
    ) -> StepResult:
        """One step with a picture of yours: BGR, uint8 (height, width, 3), at a stamp that rises.

        imu: samples since the picture before: (N, 7) stamp_s, gyro x y z (rad/s), accelerometer x y z (m/s^2) in the
        camera's optical axes. wheels: pose of the wheel odometry at the stamp, (x_m, y_m, yaw_rad), with every picture
        or with none. Raises CameraError for an invalid picture, and for a session that is closed or reads a camera.
        """
        if not isinstance(self.camera, PushedCamera):
            raise CameraError(
                f"this session reads {self.camera.info.name}: to push, open one with intrinsics= and mount= alone"
            )
        self.camera.give(image, stamp_s, imu, wheels)
        if not isinstance(self._slam, SemanticSlam):
            self._slam = self._slam(self.camera)
        try:
            return next(self._running())
        except StopIteration:
            raise CameraError("this session is closed: open another one to push pictures") from None

    def _running(self) -> Generator[StepResult, None, None]:
        """The loop, begun with the first step."""
        if self._steps is None:
            source = SearchRate(self.camera, self._rate_hz) if self._rate_hz else self.camera
            self._steps = steps(source, self.slam, self._sinks, strict=self._strict)
        return self._steps

    def __iter__(self) -> "Session":
        return self

    def __next__(self) -> StepResult:
        """The next frame's result. Raises CameraLostError for good, or what else `steps` does."""
        if isinstance(self.camera, PushedCamera):
            raise CameraError("this session has no camera to read: push pictures, or open it with camera= or frames=")
        return next(self._running())

    @property
    def map(self) -> MapObjects:
        """The objects as they stand now, ordered by id, with zones, trajectory, grid and rooms; in a notebook, the map
        from above. Once the session has ended, at the scale of a corrected lens height, as a run saves it."""
        ended = self._steps is not None and getgeneratorstate(self._steps) == GEN_CLOSED
        return self._map(self.slam.mapper.scale if ended else 1.0)

    def _map(self, scale: float) -> MapObjects:
        if not isinstance(self._slam, SemanticSlam):
            return MapObjects()
        mapper = self.slam.mapper
        annotations = self._counts.verdict(scale).on(mapper.annotations())
        objects, annotations, grid = scaled_map(self.slam.objects(), annotations, mapper.grid.grid(), scale)
        return MapObjects(objects, mapper.trajectory, annotations, grid, scale)

    @property
    def verdict(self) -> Verdict:
        """How far the map can be trusted so far: level (good, care, unreliable), findings, line."""
        return self._counts.verdict()

    def save(self, path: str | Path) -> None:
        """Write the map as map.json, atomically, at the scale of a corrected lens height. Raises MapError."""
        found = self._map(self.slam.mapper.scale)
        save_map(Path(path), list(found), found.annotations, found.grid)

    def close(self) -> None:
        """Close the sinks and the camera."""
        try:
            if self._steps is not None:
                self._steps.close()
        finally:
            self.camera.close()

    def __enter__(self) -> "Session":
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()
