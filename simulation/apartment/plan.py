"""The plan of a home: rooms side by side, solid walls between and around them, doorways and windows.

Home frame, seen from above: x right, y far, metres, origin at the outer low corner of the walls.
"""

from dataclasses import dataclass

Rectangle = tuple[float, float, float, float]
WALL_M = 0.12


def turned(rectangle: Rectangle, turn: bool) -> Rectangle:
    """The rectangle with x and y exchanged where `turn`, so that one rule serves walls along x and along y."""
    x0, y0, x1, y1 = rectangle
    return (y0, x0, y1, x1) if turn else rectangle


@dataclass(frozen=True, slots=True)
class RoomArea:
    """The floor of one room between its walls. kind: living, dining, kitchen, bedroom, bathroom, study or hall."""

    kind: str
    x0: float
    y0: float
    x1: float
    y1: float

    @property
    def rectangle(self) -> Rectangle:
        """Corners as x0, y0, x1, y1, metres."""
        return self.x0, self.y0, self.x1, self.y1

    @property
    def centre(self) -> tuple[float, float]:
        """Centre of the room."""
        return (self.x0 + self.x1) / 2.0, (self.y0 + self.y1) / 2.0

    def wall(self, side: str) -> tuple[float, float, float]:
        """Start and end of a wall along x (near, far) or y (left, right), and its face on the other axis."""
        low, near, high, far = turned(self.rectangle, side in {"left", "right"})
        return low, high, near if side in {"near", "left"} else far

    def strip(self, side: str, low_m: float, high_m: float, depth_m: float) -> Rectangle:
        """The floor before a stretch of a wall, `depth_m` into the room."""
        _, _, face = self.wall(side)
        near, far = (face, face + depth_m) if side in {"near", "left"} else (face - depth_m, face)
        return turned((low_m, near, high_m, far), side in {"left", "right"})


@dataclass(frozen=True, slots=True)
class Doorway:
    """A gap in an inner wall: its rectangle, the two rooms (indices) it joins, and whether a door leaf hangs in it.

    Without a leaf it may be wide and, where `height_m` is the room's height, without a lintel.
    """

    x0: float
    y0: float
    x1: float
    y1: float
    rooms: tuple[int, int]
    leaf: bool
    height_m: float

    @property
    def rectangle(self) -> Rectangle:
        """Corners as x0, y0, x1, y1, metres."""
        return self.x0, self.y0, self.x1, self.y1

    @property
    def across_x(self) -> bool:
        """True where one walks through it along x."""
        return self.x1 - self.x0 < self.y1 - self.y0


@dataclass(frozen=True, slots=True)
class Window:
    """A window on the inner face of an outer wall (side: left, right, near, far) of a room, from `low_m` to `high_m`
    along y (left, right) or x (near, far), `sill_m` to `top_m` above the floor."""

    room: int
    side: str
    low_m: float
    high_m: float
    sill_m: float
    top_m: float


@dataclass(frozen=True, slots=True)
class ApartmentPlan:
    """A home without furniture.

    walls: solid pieces (x0, y0, x1, y1), outer walls and open door leaves included; doorways are gaps. leaves: the
    open door leaves among them.
    """

    width_m: float
    depth_m: float
    height_m: float
    rooms: tuple[RoomArea, ...]
    walls: tuple[Rectangle, ...]
    doorways: tuple[Doorway, ...]
    windows: tuple[Window, ...]
    leaves: tuple[Rectangle, ...] = ()
