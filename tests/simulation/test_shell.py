"""Walls, floors and windows as surfaces: closed but for the doorways, facing the rooms, lit by day and by lamps."""

import numpy as np
import pytest

from edgemap.simulation.apartment.apartment import furnish
from edgemap.simulation.apartment.shell import build_shell


@pytest.fixture(scope="module", params=[9101, 9120, 42])
def built(request, furniture_catalogue):
    home = furnish(request.param)
    return home.plan, build_shell(home, np.random.default_rng(0))


def area(surface):
    return float(np.linalg.norm(np.cross(surface.u, surface.v)))


def test_floors_and_walls_have_the_area_of_the_plan(built):
    plan, parts = built
    rooms = sum((r.x1 - r.x0) * (r.y1 - r.y0) for r in plan.rooms)
    gaps = sum((d.x1 - d.x0) * (d.y1 - d.y0) for d in plan.doorways)
    floors = [s for s in parts.surfaces if s.normal[2] > 0.99 and s.corner[2] == 0.0]
    assert sum(map(area, floors)) == pytest.approx(rooms + gaps)
    # Walls of all rooms without the doorways on both their sides, and two cheeks in every doorway.
    walls = sum(2.0 * (r.x1 - r.x0 + r.y1 - r.y0) for r in plan.rooms) * plan.height_m
    for door in plan.doorways:
        width, thick = sorted((door.x1 - door.x0, door.y1 - door.y0), reverse=True)
        walls += 2.0 * (thick - width) * door.height_m
    upright = [s for s in parts.surfaces if abs(s.normal[2]) < 0.01]
    assert sum(map(area, upright)) == pytest.approx(walls)


def test_walls_face_into_a_room_or_doorway(built):
    plan, parts = built
    holes = [*(r.rectangle for r in plan.rooms), *(d.rectangle for d in plan.doorways)]
    for surface in parts.surfaces:
        x, y, _ = surface.corner + (surface.u + surface.v) / 2.0 + 0.01 * surface.normal
        assert any(x0 <= x <= x1 and y0 <= y <= y1 for x0, y0, x1, y1 in holes)


def test_every_room_has_a_lamp_and_every_window_daylight(built):
    plan, parts = built
    groups = [light.group for light in parts.lights]
    assert groups.count("lamp") == len(plan.rooms)
    assert groups.count("day") == len(plan.windows)
    for light in parts.lights:
        x, y, _ = light.centre + 0.2 * light.normal
        assert any(room.x0 <= x <= room.x1 and room.y0 <= y <= room.y1 for room in plan.rooms)


def test_panes_glow_with_the_day_and_lamps_with_the_lamps(built):
    _, parts = built
    glowing = [p.material for s in parts.solids for p in s.mesh.parts if max(p.material.emission) > 0.0]
    assert {material.group for material in glowing} == {"day", "lamp"}
