"""What a learned odometry is told of a lens: numbers by hand for a level camera and a letterboxed picture."""

import numpy as np
import pytest

from edgemap.geometry.camera.floor import FloorCamera
from edgemap.geometry.camera.intrinsics import Intrinsics
from edgemap.geometry.camera.mount import Mount
from edgemap.geometry.odometry.flow_cells import CellGrid, flow_cells

# 80x40 px in the middle of an input of 80x80: 20 grey rows above and below; cells of 20 px.
CAMERA = FloorCamera(Intrinsics(80, 40, 40.0, 40.0, 39.5, 19.5), Mount(0.5, 0.0, 0.0, 0.1, 0.02))
GRID = CellGrid(4, 4, 20, (1.0, 1.0), 0, 20, 80, 40)


def test_cells_by_hand():
    cells, mount = flow_cells(CAMERA, GRID)
    assert cells.shape == (1, 8, 4, 4)
    x, y, right_x, right_y, down_x, down_y, floor, one = cells[0, :, 2, 3]  # its middle: 70, 50 of the input
    assert (x, y) == pytest.approx((30 / 40, 10 / 40))
    assert (right_x, right_y, down_x, down_y) == pytest.approx((0.5, 0.0, 0.0, 0.5))
    assert floor == pytest.approx(0.25 / 0.5)  # a ray that falls 0.25 per metre ahead meets the floor 2 m away
    assert one == 1.0
    assert cells[0, 6, 1, 0] == 0.0  # above the horizon
    assert mount[0, 9:] == pytest.approx([0.1, 0.02, 0.5])


def test_cells_of_the_letterbox_are_zero():
    cells, _ = flow_cells(CAMERA, GRID)
    assert not cells[0, :, [0, 3]].any()
    assert (cells[0, 7, 1:3] == 1.0).all()


@pytest.mark.parametrize("place", [(0.0, 0.0), (3.0, -2.0)])
def test_the_mount_is_told_as_its_rotation_and_lens(place):
    _, mount = flow_cells(FloorCamera(CAMERA.intrinsics, Mount(0.5, 0.0, 0.0, *place)), GRID)
    assert mount[0, :9].reshape(3, 3) == pytest.approx(np.array([[0, 0, 1], [-1, 0, 0], [0, -1, 0]]))
    assert mount[0, 9:11] == pytest.approx(place)
