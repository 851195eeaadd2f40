"""A room of objects, a robot that drives round in it, and the real front and back end over a network that is scripted:
a step takes a few milliseconds. What a fuzz draws are stamps, samples and motions; what must hold after each step is
in `Checked`."""

import math
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from hypothesis import HealthCheck, Phase, settings
from hypothesis import strategies as st
from support import painted
from support.made_camera import MadeCamera
from support.pictures import noise
from support.seen import HEIGHT_M, box_of

from edgemap.geometry.camera.floor import FloorCamera
from edgemap.geometry.camera.imu import ImuSamples
from edgemap.geometry.camera.intrinsics import Intrinsics
from edgemap.geometry.camera.mount import Mount
from edgemap.geometry.map_object import MapObject
from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.camera import Camera
from edgemap.runtime.motion.attitude.estimator import open_attitude
from edgemap.runtime.motion.odometry import OdometryRules, hybrid_sources
from edgemap.runtime.motion.odometry.hybrid import HybridOdometry
from edgemap.runtime.motion.odometry.protocol import is_covariance
from edgemap.runtime.network.bundle import Bundle
from edgemap.runtime.network.manifest import Manifest
from edgemap.runtime.network.manifest_file import FORMAT
from edgemap.runtime.network.network import Compute, Network
from edgemap.runtime.step.map_file import map_document, read_map, saved_text
from edgemap.runtime.step.mapper import Mapper
from edgemap.runtime.step.pipeline import Pipeline
from edgemap.runtime.step.slam import SemanticSlam, SlamOptions, StepResult, build_slam

STEPS = int(os.environ.get("EDGEMAP_FUZZ_STEPS", "240"))  # of each fuzz
SIZE, CELLS = painted.SIZE, 8
FLOOR = FloorCamera(Intrinsics(SIZE, SIZE, 50.0, 50.0, 31.5, 31.5), Mount.from_degrees(0.6, 12.0))
# One label: of objects with two names at one place the map shows one, which is none of what is checked here.
LABEL = "chair"
ANGLES = tuple(enumerate(np.linspace(0.0, math.tau, 12, endpoint=False)))
SIZES = (1.0, 0.85, 1.1, 0.95)
ROOM = tuple((SIZES[i % 4] * 4.5 * math.cos(angle), SIZES[i % 4] * 3.5 * math.sin(angle)) for i, angle in ANGLES)
WALL = np.asarray(cv2.GaussianBlur(noise(0, (SIZE + 8, SIZE + 8, 3)), (5, 5), 0), dtype=np.uint8)
# Corners are tracked from one to the next: searching noise for known places takes a quarter of a second.
PICTURES = [np.ascontiguousarray(WALL[at : at + SIZE, at : at + SIZE]) for at in (*range(8), *range(8, 0, -1))]
followed = st.sampled_from((*7 * (False,), True))  # `corners` of `slam_of`
GRAVITY_M_S2 = 9.81


def fuzz(length: int, share: float = 1.0) -> settings:
    """As many examples of so many steps as make STEPS together, or a share of them."""
    return settings(
        max_examples=max(int(STEPS * share) // length, 1),
        phases=(Phase.explicit, Phase.generate),
        suppress_health_check=list(HealthCheck),  # pyright: ignore[reportArgumentType]
        database=None,
    )


def pose_at(path_m: float) -> SE2:
    """On an ellipse of 2.5 m by 1.5 m, counter-clockwise, so that the heading passes pi once in a lap."""
    a = path_m / 2.0
    return SE2(2.5 * math.cos(a), 1.5 * math.sin(a), math.atan2(1.5 * math.cos(a), -2.5 * math.sin(a)))


class Room:
    """What the network detects from `pose`: the objects before the camera, with half a pixel of noise."""

    def __init__(self, seed: int, pose: SE2 | None = None) -> None:
        self.pose = pose or pose_at(0.0)
        self._random = np.random.default_rng(seed)

    def bundle(self) -> Bundle:
        """A bundle of this network, without files."""
        detector = painted.detector_spec(cells=CELLS)
        manifest = Manifest(format=FORMAT, name="room", version="1", detector=detector, sha256={})
        shapes = {"image": (1, 3, SIZE, SIZE)}, {"head": detector.heads[0].shape}
        network = Network(*shapes, lambda _: [self._head()])
        return Bundle(Path("room"), manifest, network, Compute(), lambda _: network)

    def _head(self) -> np.ndarray:
        boxes = filter(None, (self._box(x_m, y_m) for x_m, y_m in ROOM))
        return painted.head_with([(LABEL, *box, 0.88) for box in boxes], CELLS)

    def _box(self, x_m: float, y_m: float) -> tuple[float, float, float, float] | None:
        ahead_m, _ = self.pose.inverse().apply(np.array([x_m, y_m]))
        box = box_of(LABEL, x_m, y_m, self.pose, FLOOR) if 0.8 < ahead_m < 5.0 else None
        if box is None:
            return None
        x0, y0, x1, y1 = box + self._random.normal(0.0, 0.3, 4)
        if min(x0, y0, SIZE - 1 - x1, SIZE - 1 - y1) < 0.0 or min(x1 - x0, y1 - y0) < 2.0:
            return None
        return (x0 + x1) / 2.0, (y0 + y1) / 2.0, x1 - x0, y1 - y0


def room_camera(count: float, before: Callable[[int], None], **options: Any) -> MadeCamera:
    """Pictures from the robot. before: called with the index of each. options: of `MadeCamera`."""
    known = {"size": (SIZE, SIZE), "intrinsics": FLOOR.intrinsics, "mount": FLOOR.mount}
    return MadeCamera(count, lambda index: PICTURES[index % 16], before=before, **known, **options)


def saved_map(first: SE2 | None = None, start: SE2 | None = None) -> list[MapObject]:
    """The room as an earlier run mapped it. first: pose in the room that has the pose `start` in that map."""
    place = (start or SE2()) @ (first or pose_at(0.0)).inverse()
    places = place.apply(np.array(ROOM))
    seen = np.eye(2) * 0.01, 0.5, HEIGHT_M, 20, 0.9, 0.0, 10.0
    return [MapObject(f"{LABEL}-{number}", LABEL, at, *seen) for number, at in enumerate(places, 1)]


def samples(stamps_s: list[float], yaw_rad_s: float, random: np.random.Generator) -> ImuSamples:
    """Of an IMU on the level robot that turns, at these stamps: gravity, the turn and noise."""
    up = FLOOR.mount.rotation_base_optical().T @ np.array([0.0, 0.0, 1.0])
    count = len(stamps_s)
    gyro, force = random.normal(0.0, 0.002, (count, 3)), random.normal(0.0, 0.05, (count, 3))
    return ImuSamples(np.array(stamps_s, dtype=np.float64), gyro + yaw_rad_s * up, force + GRAVITY_M_S2 * up)


def slam_of(camera: Camera, room: Room, imu: bool, corners: bool) -> SemanticSlam:
    """The front and back end of a robot with wheels. corners: whether its odometry also follows corners of the
    pictures, which takes longer than all the rest."""
    if corners:
        return build_slam(camera, room.bundle(), FLOOR, SlamOptions(imu=imu))
    sources = hybrid_sources(camera, FLOOR, True, OdometryRules())
    odometry = HybridOdometry({name: source for name, source in sources.items() if name != "camera"})
    front = Pipeline(room.bundle(), FLOOR, odometry, attitude=open_attitude("hybrid", camera, FLOOR, imu))
    return SemanticSlam(front, Mapper(closes_loops=True))


class Checked:
    """What holds after every step, whatever its input was; at the end, that the map reads back."""

    def __init__(self, slam: SemanticSlam, saved: list[MapObject] | None = None) -> None:
        self._slam, self._saved, self._before = slam, saved or [], list[MapObject]()
        self.steps, self._stamp_s = 0, -math.inf
        self.faults, self.kinds = list[str](), set[str]()  # texts of the front end; kinds of all

    def __call__(self, result: StepResult) -> None:
        """One more step."""
        objects = self._slam.objects()
        assert len({item.id for item in objects}) == len(objects)
        assert result.frame.stamp_s > self._stamp_s
        assert np.isfinite(result.pose_map_base.vector()).all()
        for covariance in (result.pose_covariance, *(item.covariance_m2 for item in objects)):
            assert np.isfinite(covariance).all()
            assert is_covariance(covariance)
        for item in objects:
            assert np.isfinite([*item.position_m, item.width_m, item.height_m]).all()
            assert 0.0 <= item.confidence <= 1.0
        if result.correction is not None:
            assert _missing(self._before, objects, result.merged) == []
        self._stamp_s, self._before, self.steps = result.frame.stamp_s, objects, self.steps + 1
        self.faults += map(str, result.observed.faults)
        self.kinds |= {fault.kind.value for fault in result.faults}

    def end(self) -> list[MapObject]:
        """The map, after it was written and read."""
        objects = self._slam.objects()
        read, _ = read_map(saved_text(map_document(objects)).encode(), "the map")
        assert [item.id for item in read] == [item.id for item in objects]
        if not self._slam.mapper.searching:
            assert {item.id for item in self._saved} <= {item.id for item in objects}
        return read


def _missing(before: list[MapObject], after: list[MapObject], merged: dict[str, str]) -> list[str]:
    """Objects from before a correction that are neither on the map, nor part of an object there."""
    now = {item.id for item in after}
    return [item.id for item in before if item.id not in now and _last(merged, item.id) not in now]


def _last(merged: dict[str, str], identity: str) -> str:
    while identity in merged:
        identity = merged[identity]
    return identity
