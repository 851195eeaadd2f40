"""Results of steps as sinks get them, made by hand: one box at the feet of a chair, and that chair on the map."""

from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
from support.recordings import LENS, MOUNT

from edgemap.geometry.camera.floor import FloorCamera
from edgemap.geometry.map_object import MapObject
from edgemap.geometry.observations.detections import Detections
from edgemap.geometry.observations.sighting import FloorRule, PlacedSighting, sightings_of
from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.errors import CameraState
from edgemap.runtime.frames.frame import Frame
from edgemap.runtime.frames.inference import Inference
from edgemap.runtime.motion.odometry.protocol import Motion
from edgemap.runtime.outputs.sinks.kinds import RunInfo
from edgemap.runtime.step.edit_queue import Edits
from edgemap.runtime.step.frame_observations import FrameObservations
from edgemap.runtime.step.pose_journal import PoseJournal
from edgemap.runtime.step.slam import StepResult

SPREAD = np.array([[0.04, 0.01], [0.01, 0.02]])
CHAIR = MapObject("chair-1", "chair", np.array([2.0, -1.0]), SPREAD, 0.5, 0.9, 7, 0.97, 1.0, 2.0)
POSES = [SE2(0.1 * i, 0.02 * i, 0.05 * i) for i in range(12)]
OFF = SE2(0.4, -0.3, 0.2)  # what loop closure took back
COVARIANCE = np.array([[0.01, 0.001, 0.0], [0.001, 0.02, 0.002], [0.0, 0.002, 0.03]])


def run_info(robot: str = "robo", folder: Path = Path(), **more: Any) -> RunInfo:
    """The run of a sink, whose camera stamps by ROS time. The camera's state may be set."""
    info = SimpleNamespace(name="ros2:/made")
    camera: Any = SimpleNamespace(state=CameraState.RUNNING, info=info, clock_offset_s=0.0)
    return RunInfo(folder, camera, FloorCamera(LENS, MOUNT), Edits(), Inference(), robot=robot, **more)


def results(frames: list[Frame], poses: list[SE2]) -> Iterator[StepResult]:
    """One for each frame. By odometry alone the robot is at `OFF @ pose`, with twice the covariance."""
    detections = Detections(np.array([[20.0, 10.0, 30.0, 40.0]]), np.array([0.9]), np.array([1]), ("person", "chair"))
    for frame, pose in zip(frames, poses, strict=True):
        seen = sightings_of(detections, FloorCamera(LENS, MOUNT), FloorRule(), frame.index, frame.stamp_s)
        placed = [PlacedSighting(sighting, pose, COVARIANCE) for sighting in seen]
        assert len(placed) == 1
        motion = Motion(SE2(0.1, 0.0, 0.05), np.eye(3))
        observed = FrameObservations(frame.index, frame.stamp_s, detections, seen, motion)
        yield StepResult(
            frame=frame, pictured=frame, observed=observed, sightings=placed, object_ids=["chair-1"], merged={},
            pose_map_base=pose, pose_covariance=COVARIANCE, trajectory=PoseJournal(), travelled_m=0.0, stages_ms={},
            pose_odom_base=OFF @ pose, odom_covariance=2.0 * COVARIANCE,
        )  # fmt: skip
