"""A textured floor seen on an arc, as features of a backbone that nobody trained."""

import cv2
import numpy as np
import torch

from edgemap.export.odometry.data import FeatureDrive
from edgemap.geometry.camera.floor import FloorCamera
from edgemap.geometry.camera.intrinsics import Intrinsics
from edgemap.geometry.camera.mount import Mount
from edgemap.geometry.odometry.flow_cells import flow_cells
from edgemap.geometry.se2 import SE2
from edgemap.runtime.network.manifest import InputSpec
from edgemap.runtime.network.preprocess import cell_grid

SIZE = 160
LENS = Intrinsics(SIZE, SIZE, 130.0, 130.0, 79.5, 79.5)
CAMERA = FloorCamera(LENS, Mount.from_degrees(0.5, 20.0, 0.0, 0.1))


def floor_drive(seed: int, frames: int = 24, still: bool = False) -> FeatureDrive:
    """A textured floor seen on an arc, as features: filters of the picture at stride 4, the same for every drive."""
    rng = np.random.default_rng(seed)
    noise = rng.integers(0, 255, (100, 100), dtype=np.uint8)
    texture = cv2.resize(noise, (1600, 1600), interpolation=cv2.INTER_CUBIC)
    v, u = np.mgrid[0:SIZE, 0:SIZE]
    floor = np.nan_to_num(CAMERA.floor_points(np.column_stack([u.ravel(), v.ravel()])), nan=1e3)
    motion = SE2() if still else SE2(rng.uniform(0.0, 0.06), 0.0, rng.uniform(-0.08, 0.08))
    filters = torch.randn(8, 1, 7, 7, generator=torch.Generator().manual_seed(0))
    pose, poses, features = SE2(), [], []
    for _ in range(frames):
        texel = ((pose.apply(floor) + 8.0) * 100).astype(np.float32).reshape(SIZE, SIZE, 2)
        picture = cv2.remap(texture, texel[..., 0], texel[..., 1], cv2.INTER_LINEAR, borderValue=90)
        grey = torch.from_numpy(picture).float()[None, None] / 64.0 - 2.0
        features.append(torch.nn.functional.conv2d(grey, filters, stride=4, padding=3)[0].relu().numpy())
        poses.append(pose.vector())
        pose = pose @ motion
    spec = InputSpec(name="image", width=SIZE, height=SIZE, resize="stretch", colour="bgr", scale=1.0)
    cells, mount = flow_cells(CAMERA, cell_grid(spec, SIZE, SIZE, 16))
    stamps = np.arange(frames) / 10.0
    return FeatureDrive(f"floor {seed}", np.stack(features).astype(np.float16), stamps, np.array(poses), cells, mount)
