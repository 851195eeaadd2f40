import cv2
import numpy as np
import pytest

from edgemap.simulation.record import write_video


def pictures(count):
    """A bright square that moves 8 px a picture over a gradient."""
    row = np.linspace(40, 200, 96)
    made = np.repeat(np.broadcast_to(row, (64, 96))[..., None], 3, axis=2).astype(np.uint8)
    for index in range(count):
        picture = made.copy()
        picture[20:36, 8 * index : 8 * index + 16] = 255
        yield picture


def test_a_video_has_every_picture_in_order_nearly_as_it_was(tmp_path):
    write_video(tmp_path / "video.mp4", pictures(8), 10.0)
    video = cv2.VideoCapture(str(tmp_path / "video.mp4"))
    assert video.get(cv2.CAP_PROP_FPS) == pytest.approx(10.0)
    read = []
    while (got := video.read())[0]:
        read.append(got[1])
    assert len(read) == 8
    for one, true in zip(read, pictures(8), strict=True):
        assert np.abs(one.astype(float) - true).mean() < 4.0
