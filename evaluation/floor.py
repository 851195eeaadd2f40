"""Scores of a floor mask against true labels: overlap, and the contact at which the floor ends in each column."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.camera.floor import FloorCamera
from edgemap.geometry.observations.floor_mask import FloorMask

FLOOR, UNKNOWN = 1, 255  # of true labels; all else is no floor
NEAR_M = 3.0  # contacts farther than this are not scored in metres


@dataclass
class FloorScore:
    """Pooled over pictures. `add` each; `row` gives the figures."""

    pictures: int = 0
    _overlap: int = 0
    _union: int = 0
    _errors_px: list[NDArray[np.float64]] = field(default_factory=list)
    _errors_m: list[NDArray[np.float64]] = field(default_factory=list)

    def add(self, mask: FloorMask, truth: NDArray[np.uint8], camera: FloorCamera | None = None) -> None:
        """One picture: the mask, the true labels (H, W) of all its pixels, and its camera where a mount is known."""
        rows, columns = truth.shape
        v, u = np.mgrid[0:rows, 0:columns]
        predicted = mask.at(np.column_stack([u.ravel(), v.ravel()])).reshape(rows, columns) >= 0.5
        true, labelled = truth == FLOOR, truth != UNKNOWN
        self._overlap += int((predicted & true & labelled).sum())
        self._union += int(((predicted | true) & labelled).sum())
        self.pictures += 1
        expected, columns_px = contacts(true, labelled)
        predicted_contacts = contact_rows(predicted)[columns_px]
        self._errors_px.append(np.abs(predicted_contacts - expected))
        if camera is None:
            return
        at = camera.floor_points(np.column_stack([columns_px, expected]))
        near = np.hypot(at[:, 0], at[:, 1]) <= NEAR_M  # NaN is not
        other = camera.floor_points(np.column_stack([columns_px, predicted_contacts])[near])
        gap = np.hypot(*(other - at[near]).T)
        self._errors_m.append(np.where(np.isfinite(gap), gap, np.inf))

    def row(self) -> dict[str, float | int | None]:
        """iou, pooled over pixels; boundary_px and contact_m, medians over columns where the truth has a contact; None
        where nothing could be scored, or without a mount.
        """
        return {
            "iou": round(self._overlap / self._union, 4) if self._union else None,
            "boundary_px": _median(self._errors_px),
            "contact_m": _median(self._errors_m),
            "pictures": self.pictures,
        }


def contact_rows(floor: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Per column of a picture, the row of the contact, the lower edge of the first obstacle: half a pixel above the
    topmost pixel of the lowest run of floor. H - 1/2 where a column has no floor.
    """
    up = floor[::-1]
    ended = np.logical_or.accumulate(np.logical_or.accumulate(up, axis=0) & ~up, axis=0)  # above the lowest run
    return len(floor) - 0.5 - np.where(up.any(axis=0), (~ended).sum(axis=0), 0)


def contacts(floor: NDArray[np.bool_], labelled: NDArray[np.bool_]) -> tuple[NDArray[np.float64], NDArray[np.intp]]:
    """Rows and columns of the contacts in true labels: where floor ends at another labelled class, not at the picture's
    upper border.
    """
    rows = contact_rows(floor)
    columns = np.flatnonzero(floor.any(axis=0) & (rows > 0.0))
    beyond = np.floor(rows[columns]).astype(np.intp)
    fine = labelled[beyond, columns]
    return rows[columns][fine], columns[fine]


def _median(parts: list[NDArray[np.float64]]) -> float | None:
    values = np.concatenate([np.zeros(0), *parts])
    middle = float(np.median(values)) if len(values) else np.inf
    return round(middle, 4) if np.isfinite(middle) else None
