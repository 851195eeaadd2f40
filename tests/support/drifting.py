"""A drive through a room of labelled points whose odometry drifts: motions as measured, and what was seen."""

import math
from itertools import pairwise

import numpy as np

from edgemap.geometry.observations.sighting import Sighting
from edgemap.geometry.se2 import SE2
from edgemap.runtime.odometry.protocol import Motion

SIGMAS = (0.004, 0.004, 0.004)  # m, m, rad, of one frame's motion


def drifting(way, seed=0, yaw_share=0.06, way_share=0.03):
    """Motions between true poses, measured by wheels that turn and roll a share too far, with noise."""
    random = np.random.default_rng(seed)
    motions = [Motion()]
    for before, now in pairwise(way):
        true = before.inverse() @ now
        noise = random.normal(0.0, np.array(SIGMAS) / 4.0)
        measured = SE2(
            true.x_m * (1 + way_share) + noise[0], true.y_m + noise[1], true.yaw_rad * (1 + yaw_share) + noise[2]
        )
        motions.append(Motion(measured, np.diag(np.square(SIGMAS))))
    return motions


def integrated(motions):
    """Where these motions lead, from the origin on."""
    poses = [SE2()]
    for motion in motions[1:]:
        poses.append(poses[-1] @ motion.motion)
    return poses


def sighted(room, pose, index, random, sigma_m=0.05, reach_m=4.0, half_rad=0.7):
    """Things (label, x_m, y_m) of the room in view from a true pose."""
    seen = []
    for label, x, y in room:
        place = pose.inverse().apply([x, y])
        distance = float(np.hypot(*place))
        if 0.4 < distance < reach_m and abs(math.atan2(place[1], place[0])) < half_rad:
            at = place + random.normal(0.0, sigma_m, 2)
            spread = np.eye(2) * sigma_m**2
            seen.append(
                Sighting(label, 0.8, at, spread, spread / 4, 0.5, 0.9, 0.5, distance, len(seen), index, index / 10)
            )
    return seen


def worst_m(found, true):
    """Greatest distance of poses from the true ones, both from a common start."""
    start = true[0].inverse()
    return max(
        math.hypot(pose.x_m - there.x_m, pose.y_m - there.y_m)
        for pose, there in zip(found, (start @ pose for pose in true), strict=True)
    )
