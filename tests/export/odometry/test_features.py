"""Features that training keeps belong to the pictures they were made of."""

import os

import numpy as np
import pytest

pytest.importorskip("torch")
pytest.importorskip("av")

from edgemap.export.backbones import darknet_backbone
from edgemap.export.odometry.data import FeatureStore
from edgemap.geometry.camera.intrinsics import Intrinsics
from edgemap.geometry.camera.mount import Mount
from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.trajectory import Trajectory
from edgemap.runtime.inputs.drives import CameraFile, write_drive
from edgemap.simulation.record import write_video


def filmed(folder, level):
    """A drive of three grey pictures in a video whose file time is always the same."""
    folder.mkdir(exist_ok=True)
    write_video(folder / "video.mp4", [np.full((32, 32, 3), level, np.uint8)] * 3, 10.0)
    os.utime(folder / "video.mp4", (1e9, 1e9))
    truth = Trajectory(np.arange(3) / 10.0, (SE2(), SE2(0.1), SE2(0.2)))
    lens = Intrinsics(32, 32, 30.0, 30.0, 15.5, 15.5)
    write_drive(folder, CameraFile(lens, Mount.from_degrees(0.5, 15.0), 10.0), truth)


def test_a_video_rendered_again_gets_features_of_its_own(small_cfg, small_weights, tmp_path):
    part = darknet_backbone(str(small_cfg), small_weights, "stride4", None, None, ())
    store = FeatureStore(part, tmp_path / "cache", threads=1)
    spec, found = f"drive:{tmp_path / 'home'}", []
    for level in (40, 220, 40):
        filmed(tmp_path / "home", level)
        found.append(np.array(store.drive(spec).features, dtype=float))
    assert np.abs(found[1] - found[0]).max() > 0.01
    np.testing.assert_array_equal(found[2], found[0])
    assert len(list(store.folder.glob("*.npy"))) == 2
