"""Lens and mount from rendered chessboards whose truth is exact; and pictures that must be refused."""

import cv2
import numpy as np
import pytest
from support.scenes import floor_board, held_board

from edgemap.calibrate.board import Board, BoardView
from edgemap.calibrate.floor_board import fit_mount
from edgemap.calibrate.lens import fit_lens
from edgemap.geometry.camera.floor import FloorCamera
from edgemap.geometry.camera.intrinsics import Distortion, Intrinsics
from edgemap.geometry.camera.mount import Mount
from edgemap.runtime.frames.errors import CalibrationError

LENS = Intrinsics(640, 480, 520.0, 523.0, 315.0, 243.0, Distortion("brown_conrady", (-0.12, 0.05, 8e-4, -5e-4, 0.0)))
MOUNT = Mount.from_degrees(0.52, 17.0, -1.8)
BOARD = Board(9, 6, 0.025)
TILE = Board(9, 6, 0.06)


def poses(count, lean_deg=28.0):
    """Places and leanings of a hand-held board, always wholly in view."""
    random = np.random.default_rng(11)
    for _ in range(count):
        z = random.uniform(0.32, 0.55)
        x, y = random.uniform(-1, 1, 2) * (0.55 * z - 0.10, 0.40 * z - 0.07)
        yield (float(x), float(y), float(z)), tuple(random.uniform(-lean_deg, lean_deg, 3).tolist())


@pytest.fixture(scope="module")
def held():
    images = [held_board(LENS, place, turn, seed) for seed, (place, turn) in enumerate(poses(10))]
    return [BoardView(f"{i}.png", BOARD.corners_px(image)) for i, image in enumerate(images)]


def test_corners_are_found_to_a_tenth_of_a_pixel():
    """Against the projection by OpenCV, which knows nothing of our ray tracing."""
    place, turn = (0.01, -0.01, 0.4), (20.0, -15.0, 8.0)
    corners = BOARD.corners_px(held_board(LENS, place, turn, 0))
    flat = np.column_stack([BOARD.points_m() - BOARD.points_m().mean(axis=0), np.zeros(54)])
    k = np.array([[LENS.fx, 0, LENS.cx], [0, LENS.fy, LENS.cy], [0, 0, 1.0]])
    expected = cv2.projectPoints(flat, np.radians(turn), np.array(place), k, np.array(LENS.distortion.coefficients))[0]
    error = np.linalg.norm(corners - expected[:, 0], axis=1)
    error = min(error.mean(), np.linalg.norm(corners[::-1] - expected[:, 0], axis=1).mean())
    assert error < 0.1


def test_the_lens_comes_out(held):
    fit = fit_lens(held, BOARD, (640, 480))
    found = fit.intrinsics
    np.testing.assert_allclose([found.fx, found.fy], [LENS.fx, LENS.fy], rtol=2e-3)
    np.testing.assert_allclose([found.cx, found.cy], [LENS.cx, LENS.cy], atol=1.5)
    errors = np.array([found.fx, found.fy, found.cx, found.cy]) - [LENS.fx, LENS.fy, LENS.cx, LENS.cy]
    assert (np.abs(errors) < 5 * np.array(fit.sigma_px)).all()  # and it knows how well
    assert fit.rms_px < 0.15
    # What counts: where rays go, over the whole picture; a hundredth of what a pixel is wide would be 2e-5.
    u, v = np.meshgrid(np.linspace(20, 620, 13), np.linspace(20, 460, 10))
    pixels = np.column_stack([u.ravel(), v.ravel()])
    assert np.abs(found.project(LENS.rays(pixels)) - pixels).max() < 0.8
    assert fit.record()["views"] == 10


def test_a_view_that_does_not_belong_is_left_out(held):
    crooked = held_board(LENS, (0.0, 0.0, 0.4), (5.0, 20.0, 0.0), 99, bend=1.5)
    fit = fit_lens([*held, BoardView("bent.png", BOARD.corners_px(crooked))], BOARD, (640, 480))
    assert fit.dropped == ("bent.png",)
    assert fit.intrinsics.fx == pytest.approx(LENS.fx, rel=2e-3)


def test_views_that_cannot_give_a_lens_are_refused(held):
    """Too few, in the middle only, and corners that are no board's."""
    random = np.random.default_rng(0)
    small = [BoardView(view.name, (view.corners_px - [320, 240]) * 0.3 + [320, 240]) for view in held]
    wild = [BoardView(view.name, view.corners_px + random.normal(0, 3, (54, 2))) for view in held]
    for views, message in (
        (held[:7], r"^7 different views of the complete board found, need 8"),
        (small, r"cover \d+ % of the picture's width and \d+ % of its height"),
        (wild, r"fit a lens to [3-6]\.\d\d px, expected at most 1.0 px"),
    ):
        with pytest.raises(CalibrationError, match=message):
            fit_lens(views, BOARD, (640, 480))


def test_boards_that_never_lean_leave_the_focal_length_open():
    views = []
    for seed, ((x, y, z), _) in enumerate(poses(12)):
        flat = BOARD.points_m() - BOARD.points_m().mean(axis=0)
        points = np.column_stack([flat + [x, y], np.full(54, z)])
        noise = np.random.default_rng(seed).normal(0, 0.1, (54, 2))
        views.append(BoardView(f"{seed}", LENS.project(points) + noise))
    with pytest.raises(CalibrationError, match=r"^0 of 12 boards lean by 12 degrees or more, need 4"):
        fit_lens(views, BOARD, (640, 480))


@pytest.fixture(scope="module")
def lying():
    camera = FloorCamera(LENS, MOUNT)
    # The second one needs the older detector.
    places = [((1.1, 0.05), 0.3), ((1.2, 0.4), 1.4), ((1.2, -0.4), 2.6), ((1.1, -0.1), -0.8), ((1.4, 0.0), 0.0)]
    images = [floor_board(camera, place, yaw, seed) for seed, (place, yaw) in enumerate(places)]
    return [BoardView(f"{i}.png", TILE.corners_px(image)) for i, image in enumerate(images)]


def test_the_mount_comes_out(lying):
    fit = fit_mount(lying, TILE, LENS)
    assert fit.mount.height_m == pytest.approx(MOUNT.height_m, abs=0.002)
    assert np.degrees(fit.mount.pitch_rad) == pytest.approx(17.0, abs=0.05)
    assert np.degrees(fit.mount.roll_rad) == pytest.approx(-1.8, abs=0.05)
    errors = np.array([fit.mount.height_m, fit.mount.pitch_rad, fit.mount.roll_rad])
    errors -= [MOUNT.height_m, MOUNT.pitch_rad, MOUNT.roll_rad]
    assert (np.abs(errors) < 5 * np.array(fit.sigma)).all()
    assert (np.array(fit.sigma) < [5e-4, 5e-4, 5e-4]).all()  # metres and radians: it errs by 0.7 mm and 0.4 mrad
    assert fit.rms_px < 0.25
    assert fit_mount(lying, TILE, LENS, thickness_m=0.01).mount.height_m == pytest.approx(fit.mount.height_m + 0.01)
    larger = fit_mount(lying, Board(9, 6, 0.12), LENS)  # a square of another size scales the height
    assert larger.mount.height_m == pytest.approx(2 * MOUNT.height_m, abs=0.004)


def test_a_board_on_a_box_is_refused_and_named(lying):
    low = FloorCamera(LENS, Mount(MOUNT.height_m - 0.08, MOUNT.pitch_rad, MOUNT.roll_rad))
    odd = BoardView("on-a-box.png", TILE.corners_px(floor_board(low, (1.1, 0.1), 0.4, 5)))
    with pytest.raises(CalibrationError, match=r"do not lie on one floor: \d+\.\d px off in on-a-box\.png"):
        fit_mount([*lying, odd], TILE, LENS)


def test_a_wrong_lens_and_too_few_or_too_small_boards_are_refused(lying):
    with pytest.raises(CalibrationError, match="wrong intrinsics"):
        fit_mount(lying, TILE, Intrinsics(640, 480, 700.0, 700.0, 319.5, 239.5))
    with pytest.raises(CalibrationError, match=r"^2 different views of the complete board found, need 4"):
        fit_mount(lying[:2], TILE, LENS)
    random = np.random.default_rng(0)
    camera = FloorCamera(LENS, MOUNT)
    tiny = Board(3, 3, 0.005)
    flat = (tiny.points_m() - 0.005) * [1, -1]
    far = [BoardView(f"{i}", camera.project(flat + [1.6, 0.05 * i]) + random.normal(0, 0.3, (9, 2))) for i in range(4)]
    with pytest.raises(CalibrationError, match=r"mount known to \d+\.\d cm and \d+\.\d\d deg only|horizon|impossible"):
        fit_mount(far, tiny, LENS)


@pytest.mark.parametrize(("columns", "rows", "square_m"), [(2, 6, 0.02), (9, 1, 0.02), (9, 6, 0.0), (9, 6, -1.0)])
def test_boards_that_cannot_be(columns, rows, square_m):
    with pytest.raises(CalibrationError):
        Board(columns, rows, square_m)
