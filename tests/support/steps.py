"""Steps of a made-up drive, one by one, from the real dataclasses and the real map."""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np
from support.boxed_room import CAMERA, Box, floor_mask

from edgemap.geometry.map_object import MapObject
from edgemap.geometry.observations.detections import Detections
from edgemap.geometry.observations.sighting import Sighting
from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.errors import BridgeError
from edgemap.runtime.frames.faults import Fault
from edgemap.runtime.frames.frame import Frame
from edgemap.runtime.motion.odometry.protocol import Motion
from edgemap.runtime.step.frame_observations import FrameObservations
from edgemap.runtime.step.mapper import Mapper
from edgemap.runtime.step.sinks import Sink
from edgemap.runtime.step.slam import StepResult

NAMES = ("chair", "couch", "person")
THINGS = (("chair", 3.0, 1.0), ("couch", 4.0, -1.5))  # label and place on the map, metres


class Listener:
    """A sink that keeps what it is given; fails in the steps of `bad`, with `error`."""

    def __init__(self, name="listener", bad=(), error: BaseException | None = None):
        self.name, self.bad, self.error = name, bad, error
        self.frames, self.faults, self.closed = [], [], False

    def write(self, result, objects):
        if self.error is not None and result.frame.index in self.bad:
            raise self.error
        self.frames.append(result.frame.index)

    def fault(self, fault):
        if self.error is not None:
            raise self.error
        self.faults.append(fault)

    def close(self):
        self.closed = True
        if self.error is not None:
            raise self.error


class Steps:
    """Drives straight ahead by 5 cm a step past a chair and a couch; a person stands by, boxed and never mapped."""

    def __init__(self, width: int = 320, height: int = 240, boxes: Sequence[Box] | None = None) -> None:
        """boxes: what stands in a room whose floor the picture shows; None of a bundle without a floor head."""
        self._boxes = boxes
        self.mapper = Mapper()
        self.index = 0
        self._picture = np.random.default_rng(0).integers(0, 255, (height, width, 3), dtype=np.uint8)

    def next(self, fault: Fault | None = None) -> tuple[StepResult, list[MapObject]]:
        """The next step's result, and the map after it."""
        index, pose = self.index, SE2(0.05 * self.index, 0.0, 0.0)
        boxes = np.array([[40.0, 60, 90, 160], [150, 80, 260, 170], [270, 20, 310, 200]])
        detections = Detections(boxes, np.array([0.9, 0.8, 0.7]), np.array([0, 1, 2]), NAMES)
        sightings = []
        for row, (label, x_m, y_m) in enumerate(THINGS):
            at = np.array([x_m - pose.x_m, y_m])
            small, size = 0.01 * np.eye(2), (0.5, 0.9, 0.5)
            distance_m = float(np.hypot(*at))
            sightings.append(Sighting(label, 0.9, at, small, 0.1 * small, *size, distance_m, row, index, 0.1 * index))
        frame = Frame(index, 0.1 * index, self._picture.copy(), f"made#{index}")
        faults = (fault,) if fault else ()
        motion = Motion(SE2(0.05, 0.0, 0.0), np.eye(3) * 1e-4, faults)
        stages_ms = {"preprocess": 1.0, "backbone": 10.0}
        observed = FrameObservations(index, frame.stamp_s, detections, sightings, motion, stages_ms, faults=faults)
        if self._boxes is not None:
            observed = replace(observed, camera=CAMERA, floor=floor_mask(self._boxes, pose))
        self.index += 1
        return StepResult.of(frame, observed, self.mapper.step(observed)), self.mapper.objects()

    def into(self, sink: Sink, count: int = 1) -> None:
        """Write so many steps."""
        for _ in range(count):
            sink.write(*self.next())

    def taken_by(self, sink: Sink) -> bool:
        """Whether the sink takes the next step."""
        with suppress(BridgeError):
            self.into(sink)
            return True
        return False
