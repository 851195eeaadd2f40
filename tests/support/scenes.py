"""Pictures of chessboards and of boxes in a room, drawn from exact geometry: each pixel is asked what it looks at."""

from functools import cache

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from edgemap.geometry.camera.floor import FloorCamera
from edgemap.geometry.camera.intrinsics import Intrinsics
from edgemap.geometry.camera.mount import Mount

FINER = 2  # samples per pixel, each way
NOISE = 2.0  # of the sensor, grey levels
COLUMNS, ROWS = 9, 6  # inner corners of a board
Triple = tuple[float, float, float]


@cache
def pixel_rays(lens: Intrinsics) -> np.ndarray:
    """Rays of FINER x FINER samples in every pixel, (H * FINER, W * FINER, 3)."""
    at = [(np.arange(size * FINER) + 0.5) / FINER - 0.5 for size in (lens.width, lens.height)]
    u, v = np.meshgrid(*at)
    return lens.rays(np.column_stack([u.ravel(), v.ravel()])).reshape(*u.shape, 3)


def shade(colour: np.ndarray, lens: Intrinsics, seed: int) -> np.ndarray:
    """Samples (H * FINER, W * FINER) in 0..255 to a BGR picture with sensor noise."""
    fine = colour.reshape(lens.height, FINER, lens.width, FINER).mean(axis=(1, 3))
    fine = fine + np.random.default_rng(seed).normal(0.0, NOISE, fine.shape)
    return cv2.cvtColor(np.clip(np.rint(fine), 0, 255).astype(np.uint8), cv2.COLOR_GRAY2BGR)


def board_colour(x_m: np.ndarray, y_m: np.ndarray, square_m: float) -> np.ndarray:
    """Grey of a board of 10 x 7 squares with a white rim, its middle at the origin; else floor."""
    i = np.floor(x_m / square_m + (COLUMNS + 1) / 2.0)
    j = np.floor(y_m / square_m + (ROWS + 1) / 2.0)
    inside = (i >= 0) & (i <= COLUMNS) & (j >= 0) & (j <= ROWS)
    rim = (i >= -1) & (i <= COLUMNS + 1) & (j >= -1) & (j <= ROWS + 1)
    squares = np.where((i + j) % 2 == 0, 30.0, 220.0)
    return np.where(inside, squares, np.where(rim, 220.0, 110.0))


def held_board(lens: Intrinsics, place_m: Triple, rotvec_deg: Triple, seed: int, bend: float = 0.0) -> np.ndarray:
    """A board with its middle at a place of the optical frame, turned. bend: m^-1, how much it is curved."""
    rays = pixel_rays(lens)
    rotation = Rotation.from_rotvec(rotvec_deg, degrees=True).as_matrix()
    normal, middle = rotation[:, 2], np.array(place_m)
    depth = (normal @ middle) / (rays @ normal)
    on_board = (rays * depth[..., None] - middle) @ rotation
    x, y = on_board[..., 0], on_board[..., 1]
    x = x * (1.0 + bend * x)
    return shade(board_colour(x, y, 0.025), lens, seed)


def floor_board(camera: FloorCamera, place_m: tuple[float, float], yaw_rad: float, seed: int) -> np.ndarray:
    """A board on the floor with its middle at a place of the base frame, seen by a mounted camera."""
    rays = pixel_rays(camera.intrinsics) @ camera.mount.rotation_base_optical().T
    lens = camera.mount.position_base_m()
    down = np.where(rays[..., 2] < -1e-6, -rays[..., 2], np.nan)
    x = lens[0] + rays[..., 0] * lens[2] / down - place_m[0]
    y = lens[1] + rays[..., 1] * lens[2] / down - place_m[1]
    c, s = np.cos(yaw_rad), np.sin(yaw_rad)
    # Seen from above a board is as it was printed: its rows go down, to the right hand of its columns.
    grey = board_colour(c * x + s * y, s * x - c * y, 0.06)
    return shade(np.where(np.isfinite(grey) & np.isfinite(x), grey, 160.0), camera.intrinsics, seed)


def room(lens: Intrinsics, mount: Mount, yaw_rad: float, seed: int) -> np.ndarray:
    """A room of 8 x 6 x 2.5 m with panelled walls, seen from somewhere near its middle, heading yaw_rad."""
    random = np.random.default_rng(seed)
    c, s = np.cos(yaw_rad), np.sin(yaw_rad)
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    rays = pixel_rays(lens) @ (turn @ mount.rotation_base_optical()).T
    eye = np.array([*random.uniform(-0.8, 0.8, 2), mount.height_m])
    low, high = np.array([-4.0, -3.0, 0.0]), np.array([4.0, 3.0, 2.5])
    with np.errstate(divide="ignore"):
        reach = np.where(rays > 0, (high - eye) / rays, (low - eye) / rays)
    wall = reach.argmin(axis=-1)
    points = eye + rays * reach.min(axis=-1)[..., None]
    panel = np.floor(points / np.array([0.9, 0.7, 0.55]) + 0.31).astype(int)
    across = np.where(wall[..., None] == np.arange(3), 0, panel)
    grey = 60.0 + 150.0 * ((across @ np.array([7, 13, 29]) + 3 * wall) * 0.618 % 1.0)
    return shade(np.where(wall == 2, 120.0, grey), lens, seed)
