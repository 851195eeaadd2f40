"""The worst false boxes and the largest misses of a detector, each cut out of its picture."""

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from edgemap.evaluation.detection import ScoredPicture, match_boxes
from edgemap.runtime.frames.disk import make_folder
from edgemap.runtime.frames.reading import library_path

TILE_PX, COLUMNS, TILES = 240, 5, 20
FALSE, MISSED, TEXT = (60, 60, 255), (0, 200, 255), (255, 255, 255)  # BGR


# A box that is wrong or was missed: its rank, the worst first, its text, and what is cut out of its picture.
Mistake = tuple[float, str, NDArray[np.uint8]]


class Mistakes:
    """Collects mistakes picture by picture and keeps the worst; `save` draws them."""

    def __init__(self, names: tuple[str, ...]) -> None:
        self._names = names
        self._false: list[Mistake] = []
        self._missed: list[Mistake] = []

    def add(self, image: NDArray[np.uint8], picture: ScoredPicture) -> None:
        """A picture with the boxes that count at the bundle's threshold."""
        matches = match_boxes(picture)
        for row in np.flatnonzero(~matches.hit & ~matches.free):
            score = float(picture.scores[row])
            text = f"{self._names[picture.labels[row]]} {score:.2f}"
            self._false.append((score, text, _tile(image, picture.boxes[row], FALSE)))
        for row in np.flatnonzero(~matches.found & picture.scored):
            box = picture.true_boxes[row]
            share = float((box[2:] - box[:2]).prod()) / (image.shape[0] * image.shape[1])
            self._missed.append((share, self._names[picture.true_labels[row]], _tile(image, box, MISSED)))
        for kept in (self._false, self._missed):
            kept.sort(key=lambda mistake: -mistake[0])
            del kept[TILES:]

    def save(self, folder: Path) -> list[Path]:
        """Writes false_boxes.png and misses.png, each where it has any."""
        make_folder(folder)
        written = []
        for name, mistakes in (("false_boxes.png", self._false), ("misses.png", self._missed)):
            if mistakes:
                cv2.imwrite(library_path(folder / name), _sheet(mistakes))
                written.append(folder / name)
        return written


def _tile(image: NDArray[np.uint8], box: NDArray[np.float64], colour: tuple[int, int, int]) -> NDArray[np.uint8]:
    """The box with half of its longer side round it, on a square."""
    side = max(2.0 * float((box[2:] - box[:2]).max()), 32.0)
    scale = TILE_PX / side
    corner = (box[:2] + box[2:]) / 2.0 - side / 2.0
    matrix = np.array([[scale, 0.0, -corner[0] * scale], [0.0, scale, -corner[1] * scale]])
    tile = cv2.warpAffine(image, matrix, (TILE_PX, TILE_PX), borderMode=cv2.BORDER_CONSTANT)
    first, last = ((edge * scale).round().astype(int).tolist() for edge in (box[:2] - corner, box[2:] - corner))
    return np.asarray(cv2.rectangle(tile, first, last, colour, 2), np.uint8)


def _sheet(mistakes: list[Mistake]) -> NDArray[np.uint8]:
    rows = -(-len(mistakes) // COLUMNS)
    sheet = np.zeros((rows * TILE_PX, COLUMNS * TILE_PX, 3), np.uint8)
    for number, (_, text, tile) in enumerate(mistakes):
        top, left = number // COLUMNS * TILE_PX, number % COLUMNS * TILE_PX
        cv2.putText(tile, text, (6, 18), cv2.FONT_HERSHEY_SIMPLEX, 0.5, TEXT, 1, cv2.LINE_AA)
        sheet[top : top + TILE_PX, left : left + TILE_PX] = tile
    return sheet
