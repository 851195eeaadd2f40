"""Drives through a room of labelled points without pictures: what a front end would observe, for the real Mapper."""

import math

import numpy as np

from edgemap.geometry.observations.detections import Detections
from edgemap.geometry.observations.sighting import Sighting
from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.frame import Frame
from edgemap.runtime.motion.odometry.protocol import Motion
from edgemap.runtime.step.frame_observations import FrameObservations
from edgemap.runtime.step.mapper import Mapper
from edgemap.runtime.step.slam import StepResult


def sighted(room, pose, index, random, sigma_m=0.05, reach_m=4.0, half_rad=0.7):
    """Objects (label, x_m, y_m) of the room in view from a true pose."""
    seen = []
    for label, x, y in room:
        place = pose.inverse().apply([x, y])
        distance = float(np.hypot(*place))
        if 0.4 < distance < reach_m and abs(math.atan2(place[1], place[0])) < half_rad:
            at = place + random.normal(0.0, sigma_m, 2)
            own = np.eye(2) * sigma_m**2
            seen.append(Sighting(label, 0.8, at, own, own / 4, 0.5, 0.9, 0.5, distance, len(seen), index, index / 10))
    return seen


def observed(index, sightings, motion, detections=None):
    """What the front end hands on of one frame, ten a second."""
    count = len(sightings)
    boxes = detections or Detections(np.zeros((count, 4)), np.full(count, 0.8), np.zeros(count, np.int64), ("thing",))
    return FrameObservations(index, index / 10, boxes, sightings, motion)


def drive(mapper: Mapper, room, poses, motions, seed=0, **view):
    """Results of a drive past a room through the real mapper, and its map after each. motions: as odometry has them."""
    random = np.random.default_rng(seed)
    for index, (pose, motion) in enumerate(zip(poses, motions, strict=True)):
        seen = observed(index, sighted(room, pose, index, random, **view), motion)
        update = mapper.step(seen)
        yield StepResult.of(Frame(index, index / 10, np.zeros((2, 2, 3), np.uint8)), seen, update), mapper.objects()


def exact(poses):
    """Motions of an odometry without error."""
    return [Motion(before.inverse() @ now) for before, now in zip([poses[0], *poses], poses, strict=False)]


def round_trip(frames, centre=(4.0, 3.0), radius_m=1.2, turns=1.0, start_rad=0.0):
    """Poses on a circle about a point of the room, facing along it."""
    angles = start_rad + np.linspace(0.0, turns * math.tau, frames)
    x_m, y_m = centre
    return [SE2(x_m + radius_m * math.cos(a), y_m + radius_m * math.sin(a), a + math.pi / 2) for a in angles]
