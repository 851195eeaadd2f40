"""The bare home: floors, walls, ceilings, trim, doors, windows, lamps, rugs and pictures, with the light they give."""

import numpy as np

from edgemap.simulation.apartment import decor, openings
from edgemap.simulation.apartment.apartment import Apartment
from edgemap.simulation.apartment.plan import ApartmentPlan, Rectangle, RoomArea, turned
from edgemap.simulation.render.mesh import Array, Material, Mesh
from edgemap.simulation.render.scene import ROOM_ID, AreaLight, Scene, Surface

_CEILING = Material((0.84, 0.84, 0.82))
_SKIRTING_DEPTH_M = 0.014


def build_shell(apartment: Apartment, rng: np.random.Generator) -> Scene:
    """Surfaces, trim and lights of a home; its furniture determines where pictures fit."""
    plan, trim = apartment.plan, decor.trim(rng)
    surfaces: list[Surface] = []
    lights: list[AreaLight] = []
    solid: Mesh = []
    for room in plan.rooms:
        walls, skirting = decor.walls(room.kind, rng), float(rng.uniform(0.06, 0.11))
        floor, tile = decor.floor(room.kind, rng)
        surfaces.append(_lying(room.rectangle, floor, tile))
        over = _lying(room.rectangle, _CEILING)
        surfaces.append(Surface(over.corner + [0.0, 0.0, plan.height_m], over.v, over.u, _CEILING))
        for side in ("near", "far", "left", "right"):
            for low, high, bottom in wall_pieces(plan, room, side):
                material, tile = walls[side]
                frame, up = openings.WallFrame(room, side, low, high), np.array([0.0, 0.0, plan.height_m - bottom])
                corner, along = frame.point(0.0, 0.0, bottom), frame.along * (high - low)
                surfaces.append(Surface(corner, along, up, material, (tile, tile)))
                if bottom == 0.0:
                    solid += openings.block(room.strip(side, low, high, _SKIRTING_DEPTH_M), 0.0, skirting, trim)
        light, lamp = decor.ceiling_lamp(room, plan.height_m, rng)
        lights.append(light)
        solid += lamp
        surfaces += decor.rugs(room, rng)
        for door in plan.doorways:
            if plan.rooms[door.rooms[0]] is room:
                plain = walls["near"][0]
                surfaces += [_lying(door.rectangle, floor, tile), *openings.reveals(door, plan, plain)]
    for door in plan.doorways:
        solid += openings.door_frame(door, trim)
    for leaf in plan.leaves:
        solid += openings.door_leaf(leaf, trim)
    for window in plan.windows:
        light, mesh = openings.window(window, plan.rooms[window.room], trim, rng)
        lights.append(light)
        solid += mesh
    solid += decor.pictures(apartment, rng)
    return Scene(tuple(surfaces), {ROOM_ID: solid}, tuple(lights))


def wall_pieces(plan: ApartmentPlan, room: RoomArea, side: str) -> list[tuple[float, float, float]]:
    """Stretches of one wall of a room: low, high along it and the height they start at (0, or above a doorway)."""
    low, high, face = room.wall(side)
    pieces, at = [], low
    doors = []
    for door in plan.doorways:
        start, near, end, far = turned(door.rectangle, side in {"left", "right"})
        if min(abs(face - near), abs(face - far)) < 1e-6 and low - 1e-6 < start and end < high + 1e-6:
            doors.append((start, end, door.height_m))
    for start, end, top in sorted(doors):
        pieces.append((at, start, 0.0))
        if top < plan.height_m - 1e-6:
            pieces.append((start, end, top))
        at = end
    return [*pieces, (at, high, 0.0)]


def _lying(rectangle: Rectangle, material: Material, tile: float = 1.0) -> Surface:
    x0, y0, x1, y1 = rectangle
    corner: Array = np.array([x0, y0, 0.0])
    return Surface(corner, np.array([x1 - x0, 0.0, 0.0]), np.array([0.0, y1 - y0, 0.0]), material, (tile, tile))
