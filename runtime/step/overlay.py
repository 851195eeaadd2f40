"""Drawings over the camera's picture: boxes, and the horizon with a metre grid by which the eye checks the mount."""

from itertools import pairwise

import cv2
import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.camera.floor import FloorCamera
from edgemap.geometry.observations.detections import Detections
from edgemap.geometry.observations.floor_mask import FloorMask
from edgemap.geometry.observations.sighting import Sighting

Picture = NDArray[np.uint8]
Plate = tuple[int, int, int, int]  # left, top, right, bottom, px

GRID_M = 6  # ahead and to both sides


class Bgr:
    """Colours of what is drawn."""

    HORIZON = 60, 60, 255
    GRID = 255, 220, 80
    FLOOR_BOX = 90, 200, 60
    OTHER_BOX = 160, 160, 160
    FLOOR = 80, 200, 60
    WALL = 230, 120, 40


def draw_floor_grid(image: Picture, camera: FloorCamera) -> Picture:
    """A copy of the picture with the horizon (red) and a metre grid on the floor, its distances from the base written.

    Where the mount is right, grid lines lie flat on the floor and the horizon cuts everything at camera height.
    """
    picture = image.copy()
    thickness = max(1, image.shape[1] // 640)
    taken = list[Plate]()
    for metre in range(1, GRID_M + 1):
        across = np.column_stack([np.full(81, float(metre)), np.linspace(-GRID_M, GRID_M, 81)])
        _polyline(picture, camera.project(across), Bgr.GRID, thickness)
        along = camera.project(np.array([[float(metre), 0.0]]))[0]
        inside = ((along >= 0) & (along < picture.shape[1::-1])).all()  # not where it is NaN
        if inside and not (taken and taken[-1][1] - along[1] < 4):  # far lines crowd each other
            _text(picture, f"{metre} m", along + [4, -4], Bgr.GRID, taken)
    for left in range(-GRID_M, GRID_M + 1):
        along = np.column_stack([np.linspace(0.3, GRID_M, 120), np.full(120, float(left))])
        _polyline(picture, camera.project(along), Bgr.GRID, thickness)
    columns = np.linspace(0, image.shape[1] - 1, 33)
    horizon = np.array([[column, camera.horizon_row(float(column))] for column in columns])
    _polyline(picture, horizon, Bgr.HORIZON, thickness + 1)
    row = camera.horizon_row()
    label = np.array([8.0, min(max(row - 6, 14), image.shape[0] - 6)])
    _text(picture, f"horizon, row {row:.0f} px", label, Bgr.HORIZON, taken)
    return picture


def draw_floor_mask(image: Picture, mask: FloorMask) -> Picture:
    """A copy of the picture with its floor tinted green and, where the network predicts them, its walls blue, in
    proportion to the probability.
    """
    picture = image.astype(np.float32)
    size = image.shape[1], image.shape[0]
    for shares, colour in ((mask.floor, Bgr.FLOOR), (mask.wall, Bgr.WALL)):
        if shares is not None:
            weight = 0.45 * cv2.resize(shares, size, interpolation=cv2.INTER_LINEAR)[..., None]
            picture += weight * (np.array(colour, np.float32) - picture)
    return picture.astype(np.uint8)


def draw_detections(image: Picture, detections: Detections, sightings: list[Sighting] | None) -> Picture:
    """A copy of the picture with all boxes: green with a distance for those on the floor, grey for the others.

    sightings: None without a mount, which leaves all boxes green and without a distance.
    """
    picture = image.copy()
    thickness = max(2, image.shape[1] // 320)
    placed = {sighting.detection: sighting for sighting in sightings or ()}
    taken: list[Plate] = []
    plates = []
    for index in np.argsort([index in placed for index in range(len(detections))], kind="stable"):
        x0, y0, x1, y1 = detections.boxes[index].round().astype(int).tolist()
        sighting = placed.get(int(index))
        colour = Bgr.OTHER_BOX if sighting is None and sightings is not None else Bgr.FLOOR_BOX
        where = f", {sighting.distance_m:.2f} m" if sighting else ", not floor" if sightings is not None else ""
        cv2.rectangle(picture, (x0, y0), (x1, y1), colour, thickness)
        text = f"{detections.labels[index]} {detections.scores[index]:.2f}{where}"
        plates.append((text, np.array([x0 + 2, max(y0 - 4, 12)]), colour))
    for text, pixel, colour in reversed(plates):  # those on the floor first
        _text(picture, text, pixel, colour, taken)
    return picture


def _polyline(picture: Picture, pixels: NDArray[np.float64], colour: tuple[int, int, int], thickness: int) -> None:
    height, width = picture.shape[:2]
    for a, b in pairwise(pixels):
        if np.isfinite([*a, *b]).all() and np.abs([*a, *b]).max() < 8 * max(width, height):
            first, second = (tuple(int(v) for v in point.round()) for point in (a, b))
            cv2.line(picture, first, second, colour, thickness, cv2.LINE_AA)


def _text(
    picture: Picture, text: str, pixel: NDArray[np.float64], colour: tuple[int, int, int], taken: list[Plate]
) -> None:
    """Text on a dark plate whose lower left corner is the pixel, kept inside the picture and off the plates that are
    there already: further down where there is room, else further up."""
    scale = max(0.45, picture.shape[1] / 1600)
    (width, height), below = cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, scale, 1)
    x = max(0, min(int(pixel[0]), picture.shape[1] - width - 4))
    lowest, step = picture.shape[0] - below, height + below + 4
    wished = max(height + 4, min(int(pixel[1]), lowest))
    rows = [*range(wished, lowest + 1, step), *range(wished - step, height + 3, -step)]
    y = next((row for row in rows if not _covers(x, row - height - 4, x + width + 4, row + below - 1, taken)), wished)
    taken.append((x, y - height - 4, x + width + 4, y + below - 1))
    cv2.rectangle(picture, (x, y - height - 4), (x + width + 4, y + below - 1), (35, 32, 30), -1)
    cv2.putText(picture, text, (x + 2, y - 2), cv2.FONT_HERSHEY_SIMPLEX, scale, colour, 1, cv2.LINE_AA)


def _covers(left: int, top: int, right: int, bottom: int, taken: list[Plate]) -> bool:
    return any(left < x1 and x0 < right and top < y1 and y0 < bottom for x0, y0, x1, y1 in taken)
