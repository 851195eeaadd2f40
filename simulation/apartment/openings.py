"""Doorways with frames and open leaves, and windows with panes that shine, sills and curtains."""

import numpy as np

from edgemap.simulation.apartment import textures
from edgemap.simulation.apartment.plan import ApartmentPlan, Doorway, Rectangle, RoomArea, Window
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


def door_frame(door: Doorway, trim: Material) -> list[Mesh]:
    """Architraves on both sides of a doorway that has a lintel."""
    if door.height_m > 2.1:
        return []
    w, d, top = _FRAME_M, _FRAME_DEPTH_M, door.height_m
    x0, y0, x1, y1 = door.rectangle
    meshes = []
    for outer in (0, 1):
        if door.across_x:
            a, b = (x0 - d, x0) if outer == 0 else (x1, x1 + d)
            spans = [((a, y0 - w), (b, y0)), ((a, y1), (b, y1 + w)), ((a, y0 - w), (b, y1 + w))]
        else:
            a, b = (y0 - d, y0) if outer == 0 else (y1, y1 + d)
            spans = [((x0 - w, a), (x0, b)), ((x1, a), (x1 + w, b)), ((x0 - w, a), (x1 + w, b))]
        for index, (low, high) in enumerate(spans):
            bottom = top if index == 2 else 0.0
            meshes.append(box((*low, bottom), (*high, top + (w if index == 2 else 0.0)), trim))
    return meshes


def door_leaf(leaf: Rectangle, trim: Material) -> Mesh:
    """An open door with a handle on either side."""
    x0, y0, x1, y1 = leaf
    parts = list(box((x0, y0, 0.01), (x1, y1, 2.02), trim).parts)
    metal = Material((0.55, 0.55, 0.56), gloss=0.5)
    for far_end in (0.08, 0.92):
        x, y = x0 + far_end * (x1 - x0), y0 + far_end * (y1 - y0)
        along_x = x1 - x0 > y1 - y0
        # Which end hangs on the wall does not matter for a lever at both.
        if along_x:
            parts += box((x - 0.05, y0 - 0.04, 1.02), (x + 0.05, y1 + 0.04, 1.045), metal).parts
        else:
            parts += box((x0 - 0.04, y - 0.05, 1.02), (x1 + 0.04, y + 0.05, 1.045), metal).parts
    return Mesh(tuple(parts))


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
    meshes = [Mesh((pane,)), *(frame.box(a, 0.0, z0, b, 0.05, z1, trim) for a, z0, b, z1 in bars)]
    if bottom > 0.3:
        meshes.append(frame.box(-0.12, 0.0, bottom - rim - 0.03, length + 0.12, 0.15, bottom - rim, trim))
    if rng.random() < 0.55:
        red, green, blue = (float(c) for c in rng.uniform(0.15, 0.8, 3))
        cloth = Material((red, green, blue))
        hem = 0.03 if rng.random() < 0.6 else max(bottom - 0.15, 0.03)
        for start in (-0.28, length - 0.02):
            meshes.append(frame.curtain(start, start + 0.30, hem, top + 0.12, cloth, rng))
        meshes.append(frame.box(-0.32, 0.06, top + 0.12, length + 0.32, 0.085, top + 0.145, trim))
    light = AreaLight(frame.point(0.0, 0.06, bottom), u, v, np.array(_DAYLIGHT), group="day")
    return light, joined(meshes)


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
        parts = []
        for i in range(count):
            low = self.point(at[i], out[i], z0)
            u = self.point(at[i + 1], out[i + 1], z0) - low
            parts.append(quad(low, u, np.array([0.0, 0.0, z1 - z0]), material))
        return Mesh(tuple(parts))


def joined(meshes: list[Mesh]) -> Mesh:
    """Several meshes as one."""
    return Mesh(tuple(part for mesh in meshes for part in mesh.parts))
