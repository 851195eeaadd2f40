"""A drive through a room of labelled points, seen by ideal geometry: no pictures, no network."""

import math

import numpy as np

from edgemap.geometry.objects.floor_map import FloorMap
from edgemap.geometry.objects.map_object import ObjectMap
from edgemap.geometry.observations.detections import Detections
from edgemap.geometry.observations.sighting import Sighting
from edgemap.geometry.se2 import SE2
from edgemap.runtime.frame import Frame
from edgemap.runtime.loop_closing import NoLoopClosure
from edgemap.runtime.odometry.protocol import Motion
from edgemap.runtime.pipeline import StepResult


class Drive:
    """Stands for a Pipeline: objects within 4 m and 45 degrees of the way ahead are sighted, with 5 cm of noise.

    room: (label, x_m, y_m). way: true poses in the room. The pose is that of an exact odometry, from the first frame.
    """

    def __init__(self, room, way, seed=0, sigma_m=0.05):
        self.room, self.way, self.sigma_m = room, way, sigma_m
        self.random = np.random.default_rng(seed)
        self.map: ObjectMap = FloorMap()
        self.pose_map_base, self.pose_covariance = SE2(), np.zeros((3, 3))
        self.loop_closer = NoLoopClosure()
        self.frame = 0

    def step(self, frame: Frame) -> StepResult:
        before, now = self.way[max(self.frame - 1, 0)], self.way[self.frame]
        self.pose_map_base = self.pose_map_base @ (before.inverse() @ now)
        sightings = []
        for label, x, y in self.room:
            place = now.inverse().apply([x, y])
            distance = float(np.linalg.norm(place))
            if 0.5 < distance < 4.0 and abs(math.atan2(place[1], place[0])) < math.radians(45):
                seen = place + self.random.normal(0.0, self.sigma_m, 2)
                sightings.append(
                    Sighting(
                        label, 0.8, seen, np.eye(2) * self.sigma_m**2, np.eye(2) * 0.02**2, 0.5, 0.9, 0.5, distance,
                        len(sightings), self.frame, frame.stamp_s,
                    )
                )  # fmt: skip
        placed = [sighting.placed(self.pose_map_base, self.pose_covariance) for sighting in sightings]
        ids = self.map.update(placed)
        self.frame += 1
        count = len(placed)
        detections = Detections(np.zeros((count, 4)), np.full(count, 0.8), np.zeros(count, dtype=np.int64), ("thing",))
        return StepResult(
            frame, detections, placed, ids, self.map.merged, Motion(), self.pose_map_base,
            self.pose_covariance, {},
        )  # fmt: skip

    def objects(self):
        return self.map.objects()


def round_trip(frames, centre=(4.0, 3.0), radius_m=1.2, turns=1.0, start_rad=0.0):
    """Poses on a circle about a point of the room, facing along it."""
    angles = start_rad + np.linspace(0.0, turns * math.tau, frames)
    return [
        SE2(centre[0] + radius_m * math.cos(a), centre[1] + radius_m * math.sin(a), a + math.pi / 2) for a in angles
    ]


def frames(count):
    """That many empty pictures, ten a second."""
    return [Frame(index, index / 10.0, np.zeros((2, 2, 3), np.uint8)) for index in range(count)]
