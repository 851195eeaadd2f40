"""Taste: colours and materials of floors and walls, rugs, pictures and ceiling lamps, drawn per home and room."""

import colorsys

import numpy as np

from edgemap.simulation.apartment import textures
from edgemap.simulation.apartment.apartment import Apartment
from edgemap.simulation.apartment.openings import WallFrame
from edgemap.simulation.apartment.plan import RoomArea
from edgemap.simulation.apartment.space import Boxes, rectangle_corners
from edgemap.simulation.render.mesh import Colour, Material, Mesh, box, quad
from edgemap.simulation.render.scene import AreaLight, Surface

_WHITE = (1.0, 1.0, 1.0)
_WOODS: tuple[Colour, ...] = (
    (184, 140, 98), (168, 122, 84), (198, 160, 118), (122, 84, 58), (210, 184, 150), (150, 128, 108), (92, 66, 50),
)  # fmt: skip
_STONES: tuple[Colour, ...] = (
    (214, 208, 196), (190, 182, 168), (168, 166, 164), (228, 226, 220), (140, 132, 124), (196, 170, 148), (90, 92, 96),
)  # fmt: skip
_PICTURE_DEPTH_M, _RUG_M = 0.022, 0.006


def hsv(hue: float, saturation: float, value: float) -> Colour:
    """A colour by hue, saturation and value (0..1) as sRGB, 0..255."""
    return tuple(255.0 * channel for channel in colorsys.hsv_to_rgb(hue % 1.0, saturation, value))


def trim(rng: np.random.Generator) -> Material:
    """Skirting, frames and doors of a home: white mostly, else wood."""
    if rng.random() < 0.7:
        return Material((0.78, 0.77, 0.74), gloss=0.08)
    wood = np.array(_pick(_WOODS, rng)) / 255.0
    return Material(tuple((wood**2.2 * 0.8).tolist()), gloss=0.08)


def floor(kind: str, rng: np.random.Generator) -> tuple[Material, float]:
    """Floor of a room and the length that its texture covers, metres."""
    chances = {"kitchen": (0.25, 0.05, 0.0), "bathroom": (0.05, 0.0, 0.0), "hall": (0.4, 0.2, 0.1)}
    wood, blocks, soft = chances.get(kind, (0.5, 0.2, 0.2))
    draw, size = rng.random(), float(rng.uniform(0.85, 1.15))
    if draw < wood:
        return Material(_WHITE, textures.planks(rng, _pick(_WOODS, rng), 768, int(rng.integers(9, 16))), gloss=0.1), 1.9
    if draw < wood + blocks:
        return Material(_WHITE, textures.parquet(rng, _pick(_WOODS, rng)), gloss=0.1), 2.0 * size
    if draw < wood + blocks + soft:
        colour = hsv(rng.random(), rng.uniform(0.0, 0.4), rng.uniform(0.35, 0.8))
        return Material(_WHITE, textures.carpet(rng, colour)), 1.2
    return Material(_WHITE, textures.tiles(rng, _pick(_STONES, rng), int(rng.integers(2, 6))), gloss=0.2), 1.6 * size


def walls(kind: str, rng: np.random.Generator) -> dict[str, tuple[Material, float]]:
    """Material and texture length per side: one paint or paper, with another on one wall now and then."""
    usual = _wall(kind, rng)
    sides: dict[str, tuple[Material, float]] = dict.fromkeys(("near", "far", "left", "right"), usual)
    if rng.random() < 0.3:
        sides[str(rng.choice(list(sides)))] = _wall(kind, rng)
    return sides


def _wall(kind: str, rng: np.random.Generator) -> tuple[Material, float]:
    pale = rng.random() < 0.65
    saturation, value = (rng.uniform(0.0, 0.15), rng.uniform(0.8, 0.95)) if pale else (
        rng.uniform(0.1, 0.42), rng.uniform(0.45, 0.85))  # fmt: skip
    colour, draw = hsv(rng.random(), saturation, value), rng.random()
    if kind == "bathroom" and draw < 0.6:
        return Material(_WHITE, textures.tiles(rng, colour, int(rng.integers(4, 9))), gloss=0.25), 1.2
    if draw < 0.25:
        return Material(_WHITE, textures.wallpaper(rng, colour)), float(rng.uniform(0.6, 1.4))
    return Material(_WHITE, textures.paint(rng, colour)), 1.0


def rugs(room: RoomArea, rng: np.random.Generator) -> list[Surface]:
    """A rug near the room's middle, in about every second room."""
    if rng.random() > {"bathroom": 0.3, "kitchen": 0.2, "living": 0.75}.get(room.kind, 0.55):
        return []
    width, depth = (float(side * rng.uniform(0.3, 0.6)) for side in (room.x1 - room.x0, room.y1 - room.y0))
    x = float(rng.uniform(room.x0 + 0.15, room.x1 - 0.15 - width) + room.centre[0] - width / 2.0) / 2.0
    y = float(rng.uniform(room.y0 + 0.15, room.y1 - 0.15 - depth) + room.centre[1] - depth / 2.0) / 2.0
    count = int(rng.integers(2, 5))
    colours = [hsv(rng.random(), rng.uniform(0.0, 0.5), rng.uniform(0.25, 0.8)) for _ in range(count)]
    pattern = textures.rug(rng, [*colours, colours[0]], 512) if rng.random() < 0.4 else textures.woven(rng, colours)
    material = Material(_WHITE, pattern)
    corner = np.array([x, y, _RUG_M])
    return [Surface(corner, np.array([width, 0.0, 0.0]), np.array([0.0, depth, 0.0]), material, (width, depth))]


def pictures(apartment: Apartment, rng: np.random.Generator) -> Mesh:
    """Framed pictures where walls are free."""
    plan, taken = apartment.plan, Boxes()
    for item in apartment.furniture:
        taken.add(item.footprint_home_m(), item.z_m, item.z_m + item.model.height_m, item.id)
    for door in plan.doorways:
        x0, y0, x1, y1 = door.rectangle
        taken.add(rectangle_corners((x0 - 0.2, y0 - 0.2, x1 + 0.2, y1 + 0.2)), 0.0, plan.height_m, 0)
    for leaf in plan.leaves:
        taken.add(rectangle_corners(leaf), 0.0, plan.height_m, 0)
    for window in plan.windows:
        wall = WallFrame(plan.rooms[window.room], window.side, window.low_m, window.high_m)
        _take(taken, wall, window.high_m - window.low_m, window.sill_m, window.top_m)
    parts = []
    for room in plan.rooms:
        for _ in range(int(rng.integers(1, 5))):
            side = str(rng.choice(["near", "far", "left", "right"]))
            low, high, _ = room.wall(side)
            width, height = float(rng.uniform(0.25, 0.95)), float(rng.uniform(0.25, 0.75))
            start, bottom = float(rng.uniform(low + 0.15, high - 0.15 - width)), float(rng.uniform(1.25, 1.55))
            wall = WallFrame(room, side, start, start + width)
            if _take(taken, wall, width, bottom, bottom + height, 0.05):
                parts += _picture(wall, width, bottom, height, rng)
    return parts


def _take(taken: Boxes, wall: WallFrame, width: float, low_m: float, high_m: float, gap_m: float = 0.35) -> bool:
    """Claim a place on a wall (`gap_m` beyond it to the sides); False where something is in the way."""
    ends = np.stack([wall.point(-gap_m, 0.001, 0.0), wall.point(width + gap_m, 0.06, 0.0)])[:, :2]
    low, high = ends.min(axis=0), ends.max(axis=0)
    corners = rectangle_corners((low[0], low[1], high[0], high[1]))
    free = not taken.meets(corners, low_m - 0.03, high_m + 0.03)
    taken.add(corners, low_m - 0.03, high_m + 0.03, 0)
    return free


def _picture(wall: WallFrame, width: float, bottom: float, height: float, rng: np.random.Generator) -> Mesh:
    image = textures.landscape(rng) if rng.random() < 0.5 else textures.abstract(rng)
    low, up = wall.point(0.0, _PICTURE_DEPTH_M + 0.003, bottom), np.array([0.0, 0.0, height])
    canvas = quad(low, wall.along * width, up, Material(_WHITE, image), (width, height))
    shade = float(rng.choice([0.03, 0.3, 0.8]))
    wood, rim = Material((shade, shade * 0.9, shade * 0.8), gloss=0.2), 0.03
    frame = wall.box(-rim, 0.0, bottom - rim, width + rim, _PICTURE_DEPTH_M, bottom + height + rim, wood)
    return [canvas, *frame]


def ceiling_lamp(room: RoomArea, height_m: float, rng: np.random.Generator) -> tuple[AreaLight, Mesh]:
    """A flat panel on the ceiling, or a shade on a cord, in the middle of the room; bright enough for its size."""
    area = (room.x1 - room.x0) * (room.y1 - room.y0)
    half, drop = (0.36, 0.06) if rng.random() < 0.6 else (0.24, float(rng.uniform(0.35, 0.6)))
    strength = 8.0 * np.clip(area / 26.0, 0.35, 1.2) * (0.4 / half) ** 2 * rng.uniform(0.8, 1.2)
    warmth = float(rng.uniform(0.68, 1.0))
    radiance = strength * np.array([1.0, 0.93 * warmth**0.4, 0.86 * warmth])
    centre = np.array([*room.centre, height_m - drop])
    corner = centre - [half, half, 0.0]
    u, v = np.array([0.0, 2.0 * half, 0.0]), np.array([2.0 * half, 0.0, 0.0])
    case = Material((0.7, 0.68, 0.64))
    low, high = corner + [-0.02, -0.02, 0.005], centre + [half + 0.02, half + 0.02, 0.06 if drop < 0.1 else 0.2]
    glowing = Material((0.0, 0.0, 0.0), emission=tuple(radiance.tolist()))
    parts = [quad(corner, u, v, glowing), *box(low, high, case)]
    if drop > 0.1:
        parts += box(centre + [-0.008, -0.008, 0.2], centre + [0.008, 0.008, drop], case)
    return AreaLight(corner - [0.0, 0.0, 0.002], u, v, radiance, group="lamp"), parts


def _pick(colours: tuple[Colour, ...], rng: np.random.Generator) -> Colour:
    colour = colours[int(rng.integers(len(colours)))]
    shade = float(rng.uniform(0.9, 1.08))
    return tuple(channel * shade for channel in colour)
