"""A bundle's floor mask: its contract, the padding cut off, and what step and odometry get of it."""

from typing import Any

import msgspec
import numpy as np
import pytest
from support import painted
from support.noise import noise
from support.refusal import refused

from edgemap.geometry.camera.floor import FloorCamera
from edgemap.geometry.camera.intrinsics import Intrinsics
from edgemap.geometry.camera.mount import Mount
from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.errors import BundleError
from edgemap.runtime.frames.frame import Frame
from edgemap.runtime.frames.trajectory import Trajectory
from edgemap.runtime.motion.odometry.protocol import NO_PRIOR
from edgemap.runtime.motion.odometry.recorded import RecordedOdometry
from edgemap.runtime.network.bundle import load_bundle
from edgemap.runtime.network.manifest import FloorSpec
from edgemap.runtime.network.manifest_file import read_manifest, write_manifest
from edgemap.runtime.network.preprocess import Placement, floor_mask
from edgemap.runtime.step.pipeline import Pipeline

CHAIR = [("chair", 40.0, 30.0, 12.0, 24.0, 0.9)]
# 64x64 input, cells of 4 px: floor in the lower half, a wall in the upper one.
PAINTED = np.zeros((1, 2, 16, 16), np.float32)
PAINTED[0, 0, 8:], PAINTED[0, 1, :8] = 0.9, 0.8


class Remembering(RecordedOdometry):
    def step(self, frame, features, prior=NO_PRIOR):
        self.floor = prior.floor
        return super().step(frame, features, prior)


def observed(folder, width=64, height=64, frames=1):
    camera = FloorCamera(Intrinsics(width, height, 50.0, 50.0, width / 2, height / 2), Mount(1.0))
    odometry = Remembering(Trajectory(np.arange(9) / 10, (SE2(),) * 9), "test")
    pipeline = Pipeline(load_bundle(folder), camera, odometry)
    results: list[Any] = [pipeline.step(Frame(k, k / 10, noise(k, (height, width, 3)))) for k in range(frames)]
    return results[-1], odometry


def test_the_mask_reaches_observations_and_odometry(tmp_path):
    folder = painted.with_floor(painted.write_painted(tmp_path / "b", CHAIR), PAINTED, 4)
    result, odometry = observed(folder)
    assert result.floor is odometry.floor
    np.testing.assert_array_equal(result.floor.floor, PAINTED[0, 0])
    np.testing.assert_array_equal(result.floor.wall, PAINTED[0, 1])
    assert (result.floor.width, result.floor.height) == (64, 64)
    np.testing.assert_allclose(result.floor.at([[30.0, 20.0], [30.0, 50.0]]), [0.0, 0.9])
    assert list(result.stages_ms).index("floor_mask") == list(result.stages_ms).index("decode") + 1


@pytest.mark.parametrize(("resize", "rows"), [("letterbox_topleft", slice(0, 8)), ("letterbox", slice(4, 12))])
def test_letterbox_padding_is_cut_off(tmp_path, resize, rows):
    folder = painted.with_floor(painted.write_painted(tmp_path / "b", CHAIR, resize=resize), PAINTED, 4)
    result, _ = observed(folder, 128, 64)  # half the input's height
    np.testing.assert_array_equal(result.floor.floor, PAINTED[0, 0, rows])
    assert (result.floor.width, result.floor.height) == (128, 64)


def test_a_picture_that_ends_within_a_cell_keeps_its_geometry():
    # Rows of 4 px whose value is their middle's row: linear, so resampling must give the true row of each new middle.
    rows = np.arange(16, dtype=np.float32) * 4.0 + 2.0
    spec = FloorSpec(name="floor", shape=(1, 1, 16, 16), stride=4, labels=("floor",))
    tensors = {"floor": np.repeat(rows[:, None], 16, axis=1)[None, None]}
    mask = floor_mask(tensors, Placement(64, 43, 0, 10, 640, 430), spec)
    assert mask.floor.shape == (11, 16)  # 43 px are 10.75 cells
    expected = 10.0 + (np.arange(11) + 0.5) * 43.0 / 11.0
    np.testing.assert_allclose(mask.floor[:, 5], expected, atol=1e-4)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"stride": 8}, "2 labels at stride 8 have (1, 2, 8, 8)"),
        ({"labels": ("floor",)}, "1 labels at stride 4 have (1, 1, 16, 16)"),
        ({"labels": ("wall", "floor")}, "floor is the first"),
    ],
)
def test_a_floor_mask_that_cannot_be_is_refused(tmp_path, change, message):
    folder = painted.with_floor(painted.write_painted(tmp_path / "b", CHAIR), PAINTED, 4)
    manifest = read_manifest(folder)
    floor = msgspec.structs.replace(manifest.detector.floor, **change)
    detector = msgspec.structs.replace(manifest.detector, floor=floor)
    write_manifest(folder, msgspec.structs.replace(manifest, detector=detector))
    assert message in refused(BundleError, load_bundle, folder)
