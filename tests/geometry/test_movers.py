import numpy as np
import pytest

from edgemap.geometry.observations.detections import share_covered


@pytest.mark.parametrize(
    ("boxes", "share"),
    [
        ([], 0.0),
        ([[0, 0, 320, 240]], 1.0),
        ([[-50, -50, 160, 240]], 0.5),
        ([[0, 0, 160, 240], [80, 0, 240, 240]], 0.75),  # together, not one after the other
        ([[160, 112, 400, 400]], 0.5 * 8 / 15),
    ],
)
def test_boxes_cover_a_share_of_the_picture_together(boxes, share):
    assert share_covered(np.array(boxes, dtype=float).reshape(-1, 4), 320, 240) == pytest.approx(share)
