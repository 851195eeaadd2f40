"""One furnished room: which furniture stands where, deterministic per seed. Home frame: x right, y far, z up, metres.

First cut: one template, a living room with a dining corner. The seed draws models, jitters places and turns,
mirrors the plan and tints floor and walls.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from edgemap.geometry.se2 import SE2
from edgemap.simulation.apartment import furniture
from edgemap.simulation.apartment.furniture import Model
from edgemap.simulation.apartment.shell import Colour, Opening, Shell
from edgemap.simulation.render.mesh import Array

_WALL_GAP_M = 0.03
# Left edge of the window in the far wall.
_WINDOW_M = 3.25
_FLOORS: tuple[Colour, ...] = ((184.0, 140.0, 98.0), (168.0, 122.0, 84.0), (198.0, 160.0, 118.0))
_WALLS: tuple[Colour, ...] = ((222.0, 219.0, 208.0), (205.0, 214.0, 212.0), (224.0, 212.0, 190.0))


@dataclass(frozen=True, slots=True)
class Placed:
    """A piece of furniture in place. id: from 1, unique in the room. label: a COCO class, or "" for mere decoration.

    pose_home_object: origin at the footprint's centre, x out of the front. z_m: what it stands on, above the floor.
    """

    id: int
    label: str
    model: Model
    pose_home_object: SE2
    z_m: float = 0.0

    @property
    def on_floor(self) -> bool:
        """True where it stands on the floor rather than on other furniture or a wall."""
        return self.z_m < 0.02

    def footprint_home_m(self) -> Array:
        """Corners (4, 2) of its oriented bounding rectangle, counter-clockwise."""
        x, y = self.model.depth_m / 2.0, self.model.width_m / 2.0
        return self.pose_home_object.apply([[x, -y], [x, y], [-x, y], [-x, -y]])


@dataclass(frozen=True, slots=True)
class Apartment:
    """A shell and its furniture."""

    shell: Shell
    furniture: tuple[Placed, ...]


class _Layout:
    """Collects furniture while a template places it; mirrors on demand."""

    def __init__(self, width_m: float, depth_m: float, rng: np.random.Generator) -> None:
        self.width_m, self.depth_m, self.rng = width_m, depth_m, rng
        self.mirrored = bool(rng.random() < 0.5)
        self.placed: list[Placed] = []

    def draw(self, kind: str) -> Model:
        """One of the models of a kind."""
        choices = furniture.CHOICES[kind]
        return furniture.catalogue()[choices[int(self.rng.integers(len(choices)))]]

    def put(self, label: str, model: Model, x_m: float, y_m: float, yaw_deg: float, z_m: float = 0.0) -> Placed:
        """Place a model, its front towards the yaw."""
        yaw = math.radians(yaw_deg)
        pose = SE2(self.width_m - x_m, y_m, math.pi - yaw) if self.mirrored else SE2(x_m, y_m, yaw)
        self.placed.append(Placed(len(self.placed) + 1, label, model, pose, z_m))
        return self.placed[-1]

    def against(self, label: str, model: Model, wall: str, along_m: float, z_m: float = 0.0) -> Placed:
        """Place a model with its back to a wall (near, far, left, right), its middle `along_m` from the corner."""
        back = model.depth_m / 2.0 + _WALL_GAP_M
        x, y, yaw = {
            "near": (along_m, back, 90.0),
            "far": (along_m, self.depth_m - back, -90.0),
            "left": (back, along_m, 0.0),
            "right": (self.width_m - back, along_m, 180.0),
        }[wall]
        return self.put(label, model, x, y, yaw, z_m)

    def jitter(self, span: float) -> float:
        """A number in -span..span."""
        return float(self.rng.uniform(-span, span))


def furnish(seed: int) -> Apartment:
    """The room of a seed."""
    rng = np.random.default_rng(seed)
    width, depth = 6.2 + float(rng.uniform(-0.1, 0.2)), 4.7 + float(rng.uniform(-0.1, 0.2))
    layout = _Layout(width, depth, rng)
    _seating(layout)
    _dining(layout)
    _plants(layout)
    _decoration(layout)
    return Apartment(_shell(layout), tuple(layout.placed))


def _seating(layout: _Layout) -> None:
    """Couch on the near wall, television across the room, an easy chair on the left."""
    sofa = layout.draw("couch")
    layout.against("couch", sofa, "near", 0.85 + sofa.width_m / 2.0 + layout.jitter(0.05))
    along = 1.72 + layout.jitter(0.04)
    stand = layout.against("", layout.draw("tv stand"), "far", along)
    layout.against("tv", layout.draw("tv"), "far", along, stand.model.height_m)
    layout.put("chair", layout.draw("easy chair"), 0.62, layout.depth_m - 1.75 + layout.jitter(0.1), layout.jitter(12))


def _dining(layout: _Layout) -> None:
    """Table with chairs in the right half, things on the table, the refrigerator in the far corner."""
    rng, table = layout.rng, layout.draw("dining table")
    x, y = layout.width_m - 1.75 + layout.jitter(0.05), 1.45 + layout.jitter(0.05)
    layout.put("dining table", table, x, y, 90.0)
    chair = layout.draw("chair")
    across, along = table.depth_m / 2.0 + 0.12, table.width_m / 2.0 + 0.12
    for dx, dy, yaw in ((-0.0, across, -90.0), (0.0, -across, 90.0), (-along, 0.0, 0.0), (along, 0.0, 180.0)):
        layout.put("chair", chair, x + dx + layout.jitter(0.03), y + dy + layout.jitter(0.03), yaw + layout.jitter(9))
    for kind, dx, dy in (("vase", -0.05, 0.1), ("cup", -0.35, -0.12), ("bottle", 0.32, 0.05)):
        layout.put(kind, layout.draw(kind), x + dx, y + dy, float(rng.uniform(-180, 180)), table.height_m)
    fridge = layout.draw("refrigerator")
    layout.against("refrigerator", fridge, "far", layout.width_m - fridge.width_m / 2.0 - 0.15)


def _plants(layout: _Layout) -> None:
    """Plants in the corners that are left, and one by the television."""
    width, depth = layout.width_m, layout.depth_m
    for x, y in ((0.45, depth - 0.45), (width - 0.4, 0.4), (2.78, depth - 0.38)):
        layout.put("potted plant", layout.draw("potted plant"), x, y, float(layout.rng.uniform(-180, 180)))


def _decoration(layout: _Layout) -> None:
    """What makes it a room and no detector is asked for: door, radiator, bookcase, lamp."""
    door = layout.draw("door")
    layout.put("", door, door.depth_m / 2.0 - 0.06, 1.0 + door.width_m / 2.0, 0.0)
    layout.against("", layout.draw("radiator"), "far", _WINDOW_M + 0.75)
    layout.against("", layout.draw("bookcase"), "right", layout.depth_m - 1.75)
    layout.put("", layout.draw("floor lamp"), 0.4, 0.4, 45.0)


def _shell(layout: _Layout) -> Shell:
    rng, width, depth = layout.rng, layout.width_m, layout.depth_m

    def opening(x: float, z: float, w: float, h: float) -> Opening:
        return Opening(width - x - w if layout.mirrored else x, z, w, h)

    rug_x = width - 0.9 - 2.2 if layout.mirrored else 0.9
    return Shell(
        width,
        depth,
        floor_rgb=_FLOORS[int(rng.integers(len(_FLOORS)))],
        wall_rgb=_WALLS[int(rng.integers(len(_WALLS)))],
        rug=(rug_x, 1.25, 2.2, 1.5),
        window=opening(_WINDOW_M, 0.95, 1.5, 1.2),
        painting=opening(1.35, 1.5, 0.8, 0.55),
    )
