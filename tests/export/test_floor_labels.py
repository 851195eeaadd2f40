"""Labels of a floor head's training: shares of other, floor and wall, from label files and from a teacher."""

import sys
from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from edgemap.export.floor.labels import open_teacher
from edgemap.export.floor.pictures import named, read_shares, targets, varied
from edgemap.runtime.frames.errors import CameraError
from edgemap.runtime.network.preprocess import Placement

OTHER, FLOOR, WALL, UNKNOWN = (255, 0, 0), (0, 255, 0), (0, 0, 255), (0, 0, 0)


def test_label_files_of_one_channel_are_whole_shares_and_of_three_are_scaled_to_the_picture(tmp_path):
    cv2.imwrite(str(tmp_path / "hard.png"), np.array([[0, 1], [2, 255]], np.uint8))
    expected = np.array([[OTHER, FLOOR], [WALL, UNKNOWN]], np.uint8)
    np.testing.assert_array_equal(read_shares(tmp_path / "hard.png", (2, 2)), expected)
    cv2.imwrite(str(tmp_path / "soft.png"), np.full((4, 4, 3), (100, 130, 25), np.uint8))
    np.testing.assert_array_equal(read_shares(tmp_path / "soft.png", (6, 5)), np.full((5, 6, 3), (100, 130, 25)))
    with pytest.raises(CameraError, match="2x2 px, its picture has 3x2"):
        read_shares(tmp_path / "hard.png", (3, 2))


def test_a_label_is_the_largest_share_and_unknown_where_none_is_sure():
    shares = np.array([[(50, 200, 5), (120, 130, 5), (10, 20, 225), UNKNOWN]], np.uint8)
    np.testing.assert_array_equal(named(shares), [[1, 255, 2, 255]])


def test_targets_are_the_shares_of_each_cells_labelled_part():
    shares = np.array([[FLOOR, FLOOR, OTHER, UNKNOWN], [FLOOR, WALL, UNKNOWN, UNKNOWN]], np.uint8)
    shares = np.concatenate([shares, np.full((2, 4, 3), (51, 204, 0), np.uint8)])
    parts, labelled = targets(shares, Placement(4, 4, 0, 0, 4, 4), 2, (2, 3))
    np.testing.assert_allclose(labelled, [[1.0, 0.25, 0.0], [1.0, 1.0, 0.0]], atol=1e-6)
    np.testing.assert_allclose(parts[0], [[0.75, 0.0, 0.0], [0.8, 0.8, 0.0]], atol=1e-6)
    np.testing.assert_allclose(parts[1], [[0.25, 0.0, 0.0], [0.0, 0.0, 0.0]], atol=1e-6)


def test_views_are_cut_and_mirrored_with_their_shares():
    shares = np.zeros((60, 80, 3), np.uint8)
    shares[:, :40, 0] = shares[:, 40:, 1] = 255
    picture = np.repeat(255 - shares[..., :1], 3, axis=2)  # white on the right, where the floor is
    agree = []
    for seed in range(30):
        view, kept = varied(picture, shares, np.random.default_rng(seed))
        assert view.shape == kept.shape
        bright = view.mean(axis=2)
        floor = kept[..., 1] > 0
        if 0.1 < floor.mean() < 0.9:
            agree.append(bright[floor].mean() > bright[~floor].mean())
    assert len(agree) > 15
    assert np.mean(agree) > 0.8  # a floor may be dyed darker


class LeftToRight:
    """Stands for the teacher's network: what is bright is floor, the more the farther right it lies."""

    def __init__(self, path, num_threads):
        pass

    def allocate_tensors(self):
        pass

    def get_input_details(self):
        return [{"index": 0, "shape": np.array([1, 8, 8, 3]), "dtype": np.uint8}]

    def get_output_details(self):
        return [{"index": 1, "shape": np.array([1, 8, 8, 32]), "quantization": (0.125, 10)}]

    def set_tensor(self, index, value):
        self.picture = value

    def invoke(self):
        self.logits = np.full((1, 8, 8, 32), 10, np.uint8)
        self.logits[..., 0] = 58  # 6 after scaling: other
        self.logits[0, :, :, 4] = np.where(self.picture[0, :, :, 0] > 128, 50 + 4 * np.arange(8), 10)

    def get_tensor(self, index):
        return self.logits


def test_the_teacher_sees_a_picture_and_its_mirror_image(monkeypatch, tmp_path):
    monkeypatch.setitem(sys.modules, "ai_edge_litert", SimpleNamespace())
    monkeypatch.setitem(sys.modules, "ai_edge_litert.interpreter", SimpleNamespace(Interpreter=LeftToRight))
    label = open_teacher(tmp_path / "any.tflite")
    picture = np.zeros((8, 8, 3), np.uint8)
    picture[4:] = 255
    shares = label(picture)
    np.testing.assert_array_equal(shares, label(picture[:, ::-1])[:, ::-1])
    odds = np.exp([(40 + 4 * column) / 8.0 - 6.0 for column in (2, 5)])  # of floor against other, columns 2 and 5
    floor = (odds / (odds + 1.0 + 30.0 * np.exp(-6.0))).mean()
    assert shares[5, 2, 1] == pytest.approx(255.0 * floor, abs=1.0)
    assert (named(shares[:4]) == 0).all()
