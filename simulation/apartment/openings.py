"""Doorways with frames and open leaves, and windows with panes that shine, sills and curtains."""

from itertools import pairwise

import numpy as np

from edgemap.simulation.apartment import textures
from edgemap.simulation.apartment.plan import ApartmentPlan, Doorway, Rectangle, RoomArea, Window, turned
from edgemap.simulation.render.mesh import Array, Material, Mesh, box, quad
from edgemap.simulation.render.scene import AreaLight, Surface

_FRAME_M, _FRAME_DEPTH_M = 0.06, 0.014
_DAYLIGHT = (5.2, 5.6, 6.0)
_PANE = (0.9, 0.95, 1.0)


def reveals(door: Doorway, plan: ApartmentPlan, material: Material) -> list[Surface]:
    """The two cheeks of a doorway and its underside, seen from within the gap; its ceiling where it has no lintel."""
    up = np.array([0.0, 0.0, door.height_m])
    x, y = np.array([door.x1 - door.x0, 0.0, 0.0]), np.array([0.0, door.y1 - door.y0, 0.0])
    low: Array = np.array([door.x0, door.y0, 0.0])
    if door.across_x:
        cheeks = [Surface(low + x, -x, up, material), Surface(low + y, x, up, material)]
    else:
        cheeks = [Surface(low, y, up, material), Surface(low + x + y, -y, up, material)]
    top = min(door.height_m, plan.height_m)
    return [*cheeks, Surface(np.array([door.x0, door.y0, top]), y, x, material)]


def block(rectangle: Rectangle, low_m: float, high_m: float, material: Material) -> Mesh:
    """A box over a rectangle of the plan."""
    x0, y0, x1, y1 = rectangle
    return box((x0, y0, low_m), (x1, y1, high_m), material)


def door_frame(door: Doorway, trim: Material) -> Mesh:
    """Architraves on both sides of a doorway that has a lintel."""
    w, d, top = _FRAME_M, _FRAME_DEPTH_M, door.height_m
    if top > 2.1:
        return []
    x0, y0, x1, y1 = turned(door.rectangle, not door.across_x)
    parts = []
    for a, b in ((x0 - d, x0), (x1, x1 + d)):
        for start, end, low, high in ((y0 - w, y0, 0.0, top), (y1, y1 + w, 0.0, top), (y0 - w, y1 + w, top, top + w)):
            parts += block(turned((a, start, b, end), not door.across_x), low, high, trim)
    return parts


def door_leaf(leaf: Rectangle, trim: Material) -> Mesh:
    """An open door with a handle on either side, at both ends: which of them hangs on the wall does not matter."""
    parts = block(leaf, 0.01, 2.02, trim)
    metal = Material((0.55, 0.55, 0.56), gloss=0.5)
    along_y = leaf[2] - leaf[0] <= leaf[3] - leaf[1]
    a0, b0, a1, b1 = turned(leaf, along_y)
    for far_end in (0.08, 0.92):
        a = a0 + far_end * (a1 - a0)
        parts += block(turned((a - 0.05, b0 - 0.04, a + 0.05, b1 + 0.04), along_y), 1.02, 1.045, metal)
    return parts


def window(window: Window, room: RoomArea, trim: Material, rng: np.random.Generator) -> tuple[AreaLight, Mesh]:
    """A bright pane with frame, bars, sill and perhaps curtains; its light comes in as daylight."""
    length, bottom, top = window.high_m - window.low_m, window.sill_m, window.top_m
    frame = WallFrame(room, window.side, window.low_m, window.high_m)
    low, u, v = frame.point(0.0, 0.012, bottom), frame.along * length, np.array([0.0, 0.0, top - bottom])
    view = textures.outdoors(rng)
    pane = quad(low, u, v, Material((0.0, 0.0, 0.0), view, emission=_PANE, group="day"), (length, top - bottom))
    rim, bars = 0.06, [(-0.06, bottom - 0.06, 0.0, top + 0.06), (length, bottom - 0.06, length + 0.06, top + 0.06)]
    bars += [(0.0, bottom - rim, length, bottom), (0.0, top, length, top + rim)]
    for i in range(1, 1 + int(length > 0.7) + int(length > 1.4)):
        middle = length * i / (1 + int(length > 0.7) + int(length > 1.4))
        bars.append((middle - 0.025, bottom, middle + 0.025, top))
    parts = [pane]
    for a, z0, b, z1 in bars:
        parts += frame.box(a, 0.0, z0, b, 0.05, z1, trim)
    if bottom > 0.3:
        parts += frame.box(-0.12, 0.0, bottom - rim - 0.03, length + 0.12, 0.15, bottom - rim, trim)
    if rng.random() < 0.55:
        cloth = Material(tuple(rng.uniform(0.15, 0.8, 3).tolist()))
        hem = 0.03 if rng.random() < 0.6 else max(bottom - 0.15, 0.03)
        for start in (-0.28, length - 0.02):
            parts += frame.curtain(start, start + 0.30, hem, top + 0.12, cloth, rng)
        parts += frame.box(-0.32, 0.06, top + 0.12, length + 0.32, 0.085, top + 0.145, trim)
    light = AreaLight(frame.point(0.0, 0.06, bottom), u, v, np.array(_DAYLIGHT), group="day")
    return light, parts


class WallFrame:
    """Coordinates of a stretch of a wall: metres along it, out of it into the room, and up."""

    def __init__(self, room: RoomArea, side: str, low_m: float, high_m: float) -> None:
        # `along` runs so that along x up points into the room.
        self.along, self.out, self.origin = {
            "near": (np.array([-1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0]), np.array([high_m, room.y0, 0.0])),
            "far": (np.array([1.0, 0.0, 0.0]), np.array([0.0, -1.0, 0.0]), np.array([low_m, room.y1, 0.0])),
            "left": (np.array([0.0, 1.0, 0.0]), np.array([1.0, 0.0, 0.0]), np.array([room.x0, low_m, 0.0])),
            "right": (np.array([0.0, -1.0, 0.0]), np.array([-1.0, 0.0, 0.0]), np.array([room.x1, high_m, 0.0])),
        }[side]

    def point(self, along_m: float, out_m: float, z_m: float) -> Array:
        """Home coordinates (3,)."""
        return self.origin + along_m * self.along + out_m * self.out + np.array([0.0, 0.0, z_m])

    def box(self, a0: float, out0: float, z0: float, a1: float, out1: float, z1: float, material: Material) -> Mesh:
        """A box between two corners."""
        ends = np.stack([self.point(a0, out0, z0), self.point(a1, out1, z1)])
        return box(ends.min(axis=0), ends.max(axis=0), material)

    def curtain(self, a0: float, a1: float, z0: float, z1: float, material: Material, rng: np.random.Generator) -> Mesh:
        """A curtain of pleated cloth."""
        count = 8
        out = 0.075 + 0.03 * np.where(np.arange(count + 1) % 2, 1.0, -0.6) * rng.uniform(0.7, 1.0, count + 1)
        at = np.linspace(a0, a1, count + 1)
        edges = [self.point(a, o, z0) for a, o in zip(at, out, strict=True)]
        up = np.array([0.0, 0.0, z1 - z0])
        return [quad(low, high - low, up, material) for low, high in pairwise(edges)]
