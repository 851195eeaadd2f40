"""Seats and backs in one bent piece: plastic shells, plywood, upholstered buckets."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import CubicSpline, PchipInterpolator
from scipy.ndimage import gaussian_filter1d

from edgemap.simulation.apartment.made.seats.seat import Seat
from edgemap.simulation.apartment.made.shapes.lofts import sheet
from edgemap.simulation.render.mesh import Material, Mesh

_ROWS, _COLUMNS = 22, 13


def shell(
    rng: np.random.Generator, seat: Seat, high: float, material: Material, thickness: float, wings: float
) -> Mesh:
    """From the seat's front edge down its middle and up to the back's top, rounded at both ends.

    wings: how far its sides curl up into arms, metres. Its underside lies about at the seat's `under`.
    """
    depth, lean = seat.depth, float(rng.uniform(0.12, 0.3)) * (high - seat.top)
    z, bend = seat.under + thickness, float(rng.uniform(0.4, 0.9))
    profile = np.array(
        [
            (depth / 2.0, z - float(rng.uniform(0.0, 0.02))),
            (depth * 0.36, z + 0.005),
            (-depth * 0.1, z - 0.004),
            (-depth * 0.4, z + 0.02 * bend),
            (-depth * 0.5 - lean * 0.15, z + 0.12),
            (-depth * 0.5 - lean * 0.5, z + (high - z) * 0.55),
            (-depth * 0.5 - lean, high),
        ]
    )
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(profile, axis=0), axis=1))])
    along /= along[-1]
    ends = np.linspace(-1.0, 1.0, _ROWS)
    s = (np.sin(ends * np.pi / 2.0) * 0.35 + ends * 0.65 + 1.0) / 2.0
    middle = CubicSpline(along, profile)(s)
    waist = float(rng.uniform(0.7, 1.0))
    wide = (
        PchipInterpolator([0.0, 0.35, along[4], 1.0], [seat.front, seat.front, seat.back * waist, seat.back])(s) / 2.0
    )
    square = float(rng.choice([2.5, 4.0, 8.0]))
    wide *= np.maximum((1.0 - np.abs(2.0 * s - 1.0) ** (2.0 * square)) ** (1.0 / square), 0.5)
    across = np.linspace(-1.0, 1.0, _COLUMNS)
    tangent = np.gradient(middle, axis=0)
    facing = np.stack([tangent[:, 1], -tangent[:, 0]], axis=1)
    # Smoothed, or the sides would fold where seat and back meet.
    facing = gaussian_filter1d(facing / np.linalg.norm(facing, axis=1, keepdims=True), 3.0, axis=0, mode="nearest")
    curl = PchipInterpolator(
        [0.0, 0.3, along[3], along[5], 1.0], [0.004, 0.5 * wings, wings, 0.5 * wings, 0.12 * wings]
    )(s)
    curl = curl + float(rng.uniform(0.005, 0.03)) * np.minimum(1.0, 4.0 * s)
    rise = curl[:, None] * np.abs(across) ** float(rng.uniform(2.0, 4.0))
    points = np.stack(
        [
            middle[:, :1] + rise * facing[:, :1],
            across * wide[:, None] * (1.0 - 0.15 * rise / max(wings, 0.05)),
            middle[:, 1:] + rise * facing[:, 1:],
        ],
        axis=2,
    )
    return sheet(points, thickness, material)
