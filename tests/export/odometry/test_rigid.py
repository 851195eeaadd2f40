"""The geometry under the flow head: an independent camera model agrees, and least squares gets the motion back."""

import numpy as np
import pytest

torch = pytest.importorskip("torch")

from edgemap.export.odometry.correlation import correlate, offsets  # noqa: E402
from edgemap.export.odometry.rigid import CellGeometry, ShownCells, solve  # noqa: E402
from edgemap.geometry.camera.floor import FloorCamera  # noqa: E402
from edgemap.geometry.camera.intrinsics import Distortion, Intrinsics  # noqa: E402
from edgemap.geometry.camera.mount import Mount  # noqa: E402
from edgemap.geometry.odometry.flow_cells import CellGrid, flow_cells  # noqa: E402
from edgemap.geometry.se2 import SE2  # noqa: E402

LENS = Intrinsics(640, 480, 500, 505, 317.0, 243.0, Distortion("brown_conrady", (-0.1, 0.02, 0.001, 0.0)))
CAMERA = FloorCamera(LENS, Mount.from_degrees(0.6, 11.5, 1.0, 0.15, 0.03))
GRID = CellGrid(26, 26, 16, (0.65, 0.65), 0, 0, 416, 312)
MOTION = SE2(0.07, 0.01, 0.12)


def geometry() -> CellGeometry:
    cells, mount = flow_cells(CAMERA, GRID)
    return CellGeometry.of(torch.from_numpy(cells).double(), torch.from_numpy(mount).double())


def vector(motion: SE2):
    return torch.from_numpy(motion.vector())[None]


def test_floor_cells_were_seen_where_the_camera_model_projects_them():
    pixels = GRID.to_picture(GRID.centres_px())
    floor = CAMERA.floor_points(pixels)
    sees_floor = np.isfinite(floor).all(axis=1) & GRID.inside()
    before = CAMERA.project(MOTION.apply(floor[sees_floor]))
    cells = geometry()
    found = ShownCells.of(cells, vector(MOTION)).bearings(cells.floor)
    assert sees_floor.sum() > 200
    np.testing.assert_allclose(found[0].numpy().T[sees_floor], LENS.rays(before)[:, :2], atol=1e-6)


def test_cells_in_the_letterbox_tell_nothing():
    cells, _ = flow_cells(CAMERA, GRID)
    assert (cells[0, :, 20:] == 0.0).all()
    assert (cells[0, 7, :19] == 1.0).all()


def test_slopes_are_the_derivatives():
    cells, depth = geometry(), torch.full((1, 1, 676), 0.4, dtype=torch.float64)
    here, slopes = ShownCells.of(cells, vector(MOTION)).slopes(depth)
    for index in range(3):
        step = torch.zeros(1, 3, dtype=torch.float64)
        step[0, index] = 1e-6
        moved = ShownCells.of(cells, vector(MOTION) + step).bearings(depth)
        torch.testing.assert_close((moved - here) / 1e-6, slopes[:, :, index], atol=1e-5, rtol=1e-4)


def test_least_squares_gets_the_motion_back_and_says_how_sure_it_is():
    cells = geometry()
    seen = (cells.floor > 0).double()
    true = ShownCells.of(cells, vector(MOTION)).bearings(cells.floor)
    sigma, generator = 1e-3, torch.Generator().manual_seed(0)
    weights = (seen / sigma**2).expand(-1, 2, -1)
    nothing = torch.zeros(1, 3, dtype=torch.float64)
    errors, told = [], []
    for _ in range(60):
        measured = true + sigma * torch.randn(true.shape, generator=generator, dtype=torch.float64)
        start = nothing
        for _ in range(3):
            predicted, slopes = ShownCells.of(cells, start).slopes(cells.floor)
            found = solve(slopes, measured - predicted, weights, start, nothing, nothing + 1e-6)
            start = found.motion
        errors.append((found.motion - vector(MOTION))[0])
        told.append(found.covariance[0])
    spread = torch.stack(errors)
    assert spread.mean(dim=0).abs().max() < 1e-3
    honest = torch.einsum("ni,nij,nj->n", spread, torch.linalg.inv(torch.stack(told)), spread).mean()
    assert 2.0 < honest < 4.2  # 3 where the covariance is right; 60 draws spread by 0.3


def test_correlation_is_the_sum_of_products_at_every_offset():
    now, before = torch.randn(2, 8, 9, 11), torch.randn(2, 8, 9, 11)
    found, window = correlate(now, before, 2, 3), offsets(2, 3)
    padded = torch.nn.functional.pad(before, (3, 3, 2, 2))
    assert found.shape == (2, 9, 11, 35)
    for channel, (right, down) in enumerate(window.T.int().tolist()):
        there = padded[:, :, 2 + down : 11 + down, 3 + right : 14 + right]
        torch.testing.assert_close(found[..., channel], (now * there).sum(dim=1), atol=1e-5, rtol=1e-4)
