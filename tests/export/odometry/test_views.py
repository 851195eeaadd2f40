"""A view is what another camera would have seen: held against the floor seen by that camera itself."""

import math
from dataclasses import replace

import cv2
import numpy as np
import pytest

pytest.importorskip("torch")

import torch
from support.floor_drive import floor_drive
from support.textured_floor import CAMERA, seen_by

from edgemap.export.odometry.clips import make_batch
from edgemap.export.odometry.flow import FlowHead
from edgemap.export.odometry.recipe import FewDrives
from edgemap.export.odometry.views import AugmentedView
from edgemap.geometry.camera.floor import FloorCamera
from edgemap.geometry.odometry.flow_cells import CellGrid, flow_cells
from edgemap.geometry.se2 import SE2

LENS = CAMERA.intrinsics
GRID = CellGrid(15, 20, 16, (1.0, 1.0), 0, 0, 320, 240)


def test_a_view_pitched_and_zoomed_is_the_picture_of_that_camera():
    view = AugmentedView(pitch_rad=-math.radians(4.0), zoom=1.2)  # about the axis to the right: nose down is negative
    lens = replace(LENS, fx=1.2 * LENS.fx, fy=1.2 * LENS.fy)
    other = FloorCamera(lens, replace(CAMERA.mount, pitch_rad=CAMERA.mount.pitch_rad + math.radians(4.0)))
    pose = SE2(0.3, 0.2, 0.4)
    found, wanted = view.picture(seen_by(CAMERA, pose), LENS, 114), seen_by(other, pose)
    inside = cv2.erode((found[..., 0] != 114).astype(np.uint8), np.ones((9, 9), np.uint8)) > 0
    assert inside.mean() > 0.6
    assert np.abs(found.astype(float) - wanted)[inside].mean() < 4.0
    assert np.abs(seen_by(CAMERA, pose).astype(float) - wanted)[inside].mean() > 12.0
    cells, mount = flow_cells(view.camera(CAMERA), GRID, view.rotation())
    expected = flow_cells(other, GRID)
    np.testing.assert_allclose(cells, expected[0], atol=1e-5)
    np.testing.assert_allclose(mount, expected[1], atol=1e-6)


def test_a_mirrored_view_is_the_mirrored_world():
    """Floor points of a mirrored picture lie on the other side of the robot."""
    mount = replace(CAMERA.mount, roll_rad=0.05, left_m=0.03)
    camera = FloorCamera(replace(LENS, cx=150.0), mount)
    pixels = np.array([[40.0, 200.0], [300.0, 180.0]])
    other = AugmentedView(mirrored=True).camera(camera).floor_points([319.0, 0.0] + pixels * [-1.0, 1.0])
    np.testing.assert_allclose(other, camera.floor_points(pixels) * [1.0, -1.0], atol=1e-9)
    picture = seen_by(CAMERA, SE2())
    np.testing.assert_array_equal(AugmentedView(mirrored=True).picture(picture, LENS, 114), picture[:, ::-1])


def test_a_view_does_not_show_what_the_picture_did_not():
    yawed = AugmentedView(yaw_rad=math.radians(10.0))
    shown = yawed.shows(GRID, LENS)
    assert shown[2:-2, :16].all()
    assert not shown[:, 19].any()
    assert (yawed.picture(np.full((240, 320, 3), 7, np.uint8), LENS, 114)[120, -20:] == 114).all()


def test_a_world_of_another_size_looks_the_same():
    """Motion and height grow alike, the floor's inverse depth falls; a head in units of that size tells it apart."""
    drive = floor_drive(3, frames=6)
    batch = make_batch([(drive, np.arange(6))])
    few = FewDrives(sizes=0.3, dropped=0.0)
    varied = few.varied(FlowHead((1, 8, 40, 40), 4), batch, np.random.default_rng(0))
    size = float(varied.mount[0, 0, 11] / batch.mount[0, 0, 11])
    assert size != 1.0
    torch.testing.assert_close(varied.motions, batch.motions * torch.tensor([size, size, 1.0]))
    torch.testing.assert_close(varied.cells[:, :, 6], batch.cells[:, :, 6] / size)
    torch.testing.assert_close(varied.features, batch.features)
