import numpy as np
import pytest

from edgemap.geometry.camera.floor import FloorCamera
from edgemap.geometry.camera.intrinsics import Intrinsics
from edgemap.geometry.camera.mount import Mount
from edgemap.geometry.observations.feet import box_ranges

CAMERA = FloorCamera(Intrinsics(640, 480, 500.0, 500.0, 319.5, 239.5), Mount(1.0, 0.0))
BOX = np.array([[220.0, 120.0, 420.0, 320.0]])  # its lower edge is floor from 6.2 m on


@pytest.mark.parametrize(
    ("near", "known", "range_m"),
    [
        (1.0, 1.0, 2.0),
        (0.55, 1.0, 2.0),  # what shows through, 4 m away, is not the object
        (0.2, 1.0, 4.0),  # nor is what stands before a part of it
        (1.0, 0.4, 2.0),
        (1.0, 0.15, np.nan),
    ],
)
def test_the_range_is_that_of_the_nearer_part_that_is_large_enough(near, known, range_m):
    """near: share of the columns that show something 2 m away, the others 4 m. known: share of the rows with depth."""
    depth = np.full((480, 640), 4.0, np.float32)
    depth[:, : 220 + 40 + round(120 * near)] = 2.0  # the box is read from a fifth of it to four fifths
    depth[120 + round(30 + 150 * known) :] = 0.0
    ((found_m, sigma_m),) = box_ranges(depth, BOX, CAMERA)
    assert found_m == pytest.approx(range_m, rel=0.02, nan_ok=True)
    assert np.isnan(range_m) or 0.0 < sigma_m < 0.1 * range_m
