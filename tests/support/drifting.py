"""Odometry that drifts: motions as measured between true poses."""

import math
from itertools import pairwise

import numpy as np

from edgemap.geometry.se2 import SE2
from edgemap.runtime.motion.odometry.protocol import Motion

SIGMAS = (0.004, 0.004, 0.004)  # m, m, rad, of one frame's motion
LASTING = 2.0  # factor on the covariance, as the hybrid states it


def drifting(way, seed=0, yaw_share=0.06, way_share=0.03):
    """Motions between true poses, measured by wheels that turn and roll a share too far, with noise."""
    random = np.random.default_rng(seed)
    motions = [Motion()]
    for before, now in pairwise(way):
        true = before.inverse() @ now
        noise = random.normal(0.0, np.array(SIGMAS) / 4.0)
        x_m, yaw_rad = true.x_m * (1 + way_share) + noise[0], true.yaw_rad * (1 + yaw_share) + noise[2]
        measured = SE2(x_m, true.y_m + noise[1], yaw_rad)
        motions.append(Motion(measured, LASTING * np.diag(np.square(SIGMAS))))
    return motions


def integrated(motions):
    """Where these motions lead, from the origin on."""
    poses = [SE2()]
    for motion in motions[1:]:
        poses.append(poses[-1] @ motion.motion)
    return poses


def worst_m(found, true):
    """Greatest distance of poses from the true ones, both from a common start."""
    pairs = zip(found, (true[0].inverse() @ pose for pose in true), strict=True)
    return max(math.hypot(pose.x_m - there.x_m, pose.y_m - there.y_m) for pose, there in pairs)
