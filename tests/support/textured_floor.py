"""A drive over a textured floor, and what a camera sees of it."""

import cv2
import numpy as np

from edgemap.geometry.camera.floor import FloorCamera
from edgemap.geometry.camera.intrinsics import Intrinsics
from edgemap.geometry.camera.mount import Mount
from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.frame import Frame

CAMERA = FloorCamera(Intrinsics(320, 240, 290.0, 290.0, 159.5, 119.5), Mount.from_degrees(0.5, 15.0, 0.0, 0.12))


BLOBS = np.random.default_rng(0).integers(0, 255, (150, 150), dtype=np.uint8)
TEXTURE = cv2.cvtColor(cv2.resize(BLOBS, (1500, 1500), interpolation=cv2.INTER_CUBIC), cv2.COLOR_GRAY2BGR)


def seen_by(camera: FloorCamera, pose: SE2) -> np.ndarray:
    """What a camera sees of a textured floor (1 cm a texel, x and y from -7.5 m): sampled ray by ray."""
    shape = camera.intrinsics.height, camera.intrinsics.width
    v, u = np.mgrid[: shape[0], : shape[1]]
    points = pose.apply(np.nan_to_num(camera.floor_points(np.column_stack([u.ravel(), v.ravel()])), nan=1e3))
    texel = ((points + 7.5) * 100).astype(np.float32).reshape(*shape, 2)
    return cv2.remap(TEXTURE, texel[..., 0], texel[..., 1], cv2.INTER_LINEAR, borderValue=(90, 90, 90))


def drive(steps):
    """Frames and true poses of a drive with the given motions."""
    pose, frames, poses = SE2(), [Frame(0, 0.0, seen_by(CAMERA, SE2()))], [SE2()]
    for index, motion in enumerate(steps, start=1):
        pose = pose @ motion
        frames.append(Frame(index, index / 10, seen_by(CAMERA, pose)))
        poses.append(pose)
    return frames, poses


MOTIONS = {
    "straight": [SE2(0.04, 0, 0)] * 20, "left arc": [SE2(0.03, 0, 0.04)] * 20, "spin right": [SE2(0, 0, -0.06)] * 20,
    "reverse": [SE2(-0.03, 0, 0.01)] * 20, "stand": [SE2()] * 10,
}  # fmt: skip
