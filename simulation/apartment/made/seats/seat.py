"""What a person sits on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from edgemap.simulation.apartment.made.materials.cloths import upholstery, woven
from edgemap.simulation.apartment.made.shapes.lofts import pad, plate
from edgemap.simulation.apartment.made.shapes.outlines import oval
from edgemap.simulation.render.mesh import Array, Material, Mesh


@dataclass(frozen=True, slots=True)
class Seat:
    """depth, width in front (front) and behind (back), height of its underside (under) and of its top."""

    depth: float
    front: float
    back: float
    under: float
    top: float

    def corners(self, inset: float) -> Array:
        """Where four legs meet the seat (4, 3): front left, front right, rear left, rear right."""
        x, front, back = self.depth / 2.0 - inset, self.front / 2.0 - inset, self.back / 2.0 - inset
        return np.array([[x, s * front, self.under] for s in (1, -1)] + [[-x, s * back, self.under] for s in (1, -1)])

    def outline(self, squareness: float) -> Array:
        """Of its top, closed (N, 2)."""
        return oval(self.depth, self.front, squareness, width_behind=self.back)


def drawn_seat(rng: np.random.Generator, top: float, widths: tuple[float, float], thickness: float) -> Seat:
    """As wide in front as between two widths, a little narrower behind, about as deep."""
    front = float(rng.uniform(*widths))
    back = front * float(rng.uniform(0.8, 1.0))
    return Seat(front * float(rng.uniform(0.9, 1.05)), front, back, top - thickness, top)


def cushioned(rng: np.random.Generator, seat: Seat, square: float, body: Material) -> list[Mesh]:
    """A board or woven seat, or one with a padding on it."""
    shape = seat.outline(square)
    if rng.random() < 0.45:
        return [plate(shape, seat.under, seat.top, body if rng.random() < 0.75 else woven(rng))]
    split = seat.under + 0.4 * (seat.top - seat.under)
    base = [plate(shape * 0.98, seat.under, split, body)]
    return [*base, pad(shape, split, seat.top, upholstery(rng), float(rng.uniform(0.0, 0.025)))]
