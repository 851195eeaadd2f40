"""Places furniture: against walls, in corners, beside and on top of other pieces; what does not fit is omitted."""

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np

from edgemap.geometry.se2 import SE2
from edgemap.simulation.apartment import furniture
from edgemap.simulation.apartment.furniture import Model, Purpose, Tint
from edgemap.simulation.apartment.plan import ApartmentPlan, RoomArea
from edgemap.simulation.apartment.space import Boxes, Floor, rectangle_corners
from edgemap.simulation.render.mesh import Array

# Classes that move by themselves: detected, but never mapped, and not required in a home.
ALIVE = frozenset({"person", "cat", "dog"})


@dataclass(frozen=True, slots=True)
class Placed:
    """A piece of furniture in place. id: from 1, unique in the home. label: a COCO class, or "" for decoration.

    model: at this piece's own size. pose_home_object: origin at the footprint's centre, x out of the front. z_m: height
    above the floor. kind: its name in models.toml.
    """

    id: int
    label: str
    model: Model
    pose_home_object: SE2
    z_m: float = 0.0
    tint: Tint | None = None
    kind: str = ""

    @property
    def on_floor(self) -> bool:
        """True where it stands on the floor rather than on other furniture or a wall."""
        return self.z_m < 0.02

    @property
    def middle_home_m(self) -> Array:
        """Centre of its footprint, (2,)."""
        return np.array([self.pose_home_object.x_m, self.pose_home_object.y_m])

    def footprint_home_m(self) -> Array:
        """Corners (4, 2) of its oriented bounding rectangle, counter-clockwise."""
        x, y = self.model.depth_m / 2.0, self.model.width_m / 2.0
        return self.pose_home_object.apply([[x, -y], [x, y], [-x, y], [-x, -y]])


SIDES = ("near", "right", "far", "left")
_DOOR_M, _WINDOW_M = 0.7, 0.3
_TRIES = 20
_GROWS = {"potted plant", "cat", "dog", "person"}


class Layout:
    """The furniture of one home, placed piece by piece. Each method that places a piece returns it, or None where it
    does not fit. One generator draws everything, so a seed determines the furniture."""

    def __init__(self, plan: ApartmentPlan, purpose: Purpose, rng: np.random.Generator) -> None:
        self.plan, self.rng = plan, rng
        self.purpose: Purpose = purpose
        self.placed: list[Placed] = []
        self.boxes, self.floor = Boxes(), Floor(plan)
        for wall in plan.walls:
            self.boxes.add(rectangle_corners(wall), 0.0, plan.height_m, 0)
        for door in plan.doorways:
            reach_x, reach_y = (_DOOR_M, 0.0) if door.across_x else (0.0, _DOOR_M)
            keep = door.x0 - reach_x, door.y0 - reach_y, door.x1 + reach_x, door.y1 + reach_y
            self.boxes.add(rectangle_corners(keep), 0.0, door.height_m, 0)
        for window in plan.windows:
            low, high = window.low_m - 0.1, window.high_m + 0.1
            keep = plan.rooms[window.room].strip(window.side, low, high, _WINDOW_M)
            self.boxes.add(rectangle_corners(keep), window.sill_m + 0.02, window.top_m, 0)

    def model(self, kind: str) -> Model:
        """A model of a kind in a size of its own."""
        pool = furniture.kinds()[kind]
        keys = pool.choices(self.purpose)
        key = keys[int(self.rng.integers(len(keys)))]
        size = pool.scale.get(key, 1.0) * self.uniform(0.92, 1.08)
        stretch = (1.0, 1.0, 1.0)
        if pool.label and self.purpose == "training":
            stretch = (self.uniform(0.9, 1.1), self.uniform(0.9, 1.1), self.uniform(0.9, 1.1))
        return furniture.model_of(key).scaled(size, stretch)

    def put(
        self,
        kind: str,
        model: Model,
        room: RoomArea,
        pose: SE2,
        z_m: float = 0.0,
        ignore: Placed | None = None,
        like: Placed | None = None,
        spare_m: tuple[float, float] = (0.0, 0.0),
    ) -> Placed | None:
        """Places a model unless it would leave the room, collide (except with `ignore`) or block a path. like: a
        piece with the same tint. spare_m: margin that must be free around and above it.
        """
        label = furniture.kinds()[kind].label
        tint = like.tint if like else Tint.draw(self.rng, 0.12 if label in _GROWS else 1.0)
        item = Placed(len(self.placed) + 1, label, model, pose, z_m, tint, kind)
        return item if self.settle(item, room, ignore, spare_m) else None

    def settle(
        self, item: Placed, room: RoomArea, ignore: Placed | None = None, spare_m: tuple[float, float] = (0.0, 0.0)
    ) -> bool:
        """Places a piece at its own pose unless it would collide, as in `put`. Returns whether it was placed."""
        corners = item.footprint_home_m()
        if (corners < [room.x0, room.y0]).any() or (corners > [room.x1, room.y1]).any():
            return False
        top = item.z_m + item.model.height_m
        around = corners + spare_m[0] * np.sign(corners - corners.mean(axis=0))
        if top > self.plan.height_m or self.boxes.meets(
            around, item.z_m, top + spare_m[1], ignore.id if ignore else -1
        ):
            return False
        if not self.floor.takes(corners, item.z_m):
            return False
        self.boxes.add(corners, item.z_m, top, item.id)
        self.placed.append(item)
        return True

    def against_wall(
        self, kind: str, room: RoomArea, sides: Iterable[str] = SIDES, z_m: float = 0.0, above_m: float = 0.0
    ) -> Placed | None:
        """Places a model with its back to a wall, anywhere along it, with that much free space above it."""
        sides = list(sides)
        for _ in range(_TRIES):
            model, side = self.model(kind), sides[int(self.rng.integers(len(sides)))]
            pose = self.wall_pose(model, room, side, self.uniform(0.0, 1.0))
            item = self.put(kind, model, room, pose, z_m, spare_m=(0.0, above_m))
            if item is not None:
                return item
        return None

    def wall_pose(self, model: Model, room: RoomArea, side: str, along: float, gap_m: float = 0.015) -> SE2:
        """Pose of a model with its back to a wall; along: 0 in one corner, 1 in the other."""
        back, half = model.depth_m / 2.0 + gap_m, model.width_m / 2.0 + 0.01
        x = room.x0 + half + along * (room.x1 - room.x0 - 2.0 * half)
        y = room.y0 + half + along * (room.y1 - room.y0 - 2.0 * half)
        return {
            "near": SE2(x, room.y0 + back, math.radians(90.0)),
            "far": SE2(x, room.y1 - back, math.radians(-90.0)),
            "left": SE2(room.x0 + back, y, 0.0),
            "right": SE2(room.x1 - back, y, math.radians(180.0)),
        }[side]

    def some(self, room: RoomArea, place: Callable[[str, RoomArea], object], **chances: float) -> None:
        """Places each of these kinds with its probability. An underscore in a name is a space."""
        for kind, chance in chances.items():
            if self.chance(chance):
                place(kind.replace("_", " "), room)

    def in_corner(self, kind: str, room: RoomArea) -> Placed | None:
        """Places a model in a corner: seats face the room, all else has a random yaw."""
        turned = furniture.kinds()[kind].label != "chair"
        for _ in range(_TRIES):
            model = self.model(kind)
            reach = math.hypot(model.width_m, model.depth_m) / 2.0 if turned else model.width_m / 2.0
            reach += self.uniform(0.02, 0.12)
            left, near = self.chance(0.5), self.chance(0.5)
            x = room.x0 + reach if left else room.x1 - reach
            y = room.y0 + reach if near else room.y1 - reach
            yaw = self.uniform(-math.pi, math.pi)
            if not turned:
                yaw = math.atan2(1.0 if near else -1.0, 1.0 if left else -1.0)
            item = self.put(kind, model, room, SE2(x, y, yaw))
            if item is not None:
                return item
        return None

    def by_wall(self, kind: str, room: RoomArea) -> Placed | None:
        """Places a piece near a wall at a random yaw, such as plants and suitcases."""
        for _ in range(_TRIES):
            model, side = self.model(kind), SIDES[int(self.rng.integers(4))]
            pose = self.wall_pose(model, room, side, self.uniform(0.0, 1.0), self.uniform(0.03, 0.35))
            item = self.put(kind, model, room, pose @ SE2(0.0, 0.0, self.uniform(-0.9, 0.9)))
            if item is not None:
                return item
        return None

    def anywhere(self, kind: str, room: RoomArea) -> Placed | None:
        """Places a model anywhere on the open floor."""
        for _ in range(_TRIES):
            x, y = self.uniform(room.x0 + 0.2, room.x1 - 0.2), self.uniform(room.y0 + 0.2, room.y1 - 0.2)
            item = self.put(kind, self.model(kind), room, SE2(x, y, self.uniform(-math.pi, math.pi)))
            if item is not None:
                return item
        return None

    def beside(self, kind: str, anchor: Placed, room: RoomArea, gap_m: float = 0.06) -> Placed | None:
        """Places a model at either side of a piece, both backs in line."""
        for sign in self.rng.permutation([-1.0, 1.0]):
            model = self.model(kind)
            away = anchor.model.width_m / 2.0 + model.width_m / 2.0 + gap_m
            in_line = (model.depth_m - anchor.model.depth_m) / 2.0
            item = self.put(kind, model, room, anchor.pose_home_object @ SE2(in_line, sign * away, 0.0))
            if item is not None:
                return item
        return None

    def before(self, kind: str, anchor: Placed, room: RoomArea, gap_m: float, under: bool = False) -> Placed | None:
        """Places a model before a piece, turned as it is; under: turned towards it, and may reach over or under it."""
        model = self.model(kind)
        away = anchor.model.depth_m / 2.0 + model.depth_m / 2.0 + gap_m
        pose = anchor.pose_home_object @ SE2(away, self.uniform(-0.1, 0.1), math.pi if under else 0.0)
        return self.put(kind, model, room, pose, ignore=anchor if under else None)

    def on_top(
        self, kind: str, support: Placed, room: RoomArea, spread: float = 0.3, back: bool = False
    ) -> Placed | None:
        """Places a model on a piece's flat top, within the middle `spread` of it, or at its back facing as it does."""
        if support.model.top_m <= 0.0:
            return None
        depth, width = support.model.depth_m, support.model.width_m
        for _ in range(6):
            model = self.model(kind)
            x, y, yaw = (self.uniform(-spread, spread) * side for side in (depth, width, 4.0))
            if back:
                x, yaw = max(-depth / 2.0 + model.depth_m / 2.0 + 0.02, -0.1), self.uniform(-0.12, 0.12)
            fits = abs(y) + model.width_m / 2.0 < width / 2.0 and abs(x) + model.depth_m / 2.0 < depth / 2.0 + 0.03
            pose = support.pose_home_object @ SE2(x, y, yaw)
            item = self.put(kind, model, room, pose, support.z_m + support.model.top_m) if fits else None
            if item is not None:
                return item
        return None

    def uniform(self, low: float, high: float) -> float:
        """A random number between two bounds, uniformly."""
        return float(self.rng.uniform(low, high))

    def chance(self, probability: float) -> bool:
        """True with this probability."""
        return bool(self.rng.random() < probability)

    def count(self, low: int, high: int) -> int:
        """A random integer from low to high."""
        return int(self.rng.integers(low, high + 1))
