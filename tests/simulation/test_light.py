import os

import numpy as np
import pytest

from edgemap.simulation.render.light import BakeSettings, bake
from edgemap.simulation.render.mesh import Material, box
from edgemap.simulation.render.raytracer import cosine_directions, r2_sequence
from edgemap.simulation.render.scene import ROOM_ID, AreaLight, Scene, Surface

GREY = Material((0.5, 0.5, 0.5))
CEILING = AreaLight(np.array([1.2, 1.2, 2.45]), np.array([0, 0.6, 0.0]), np.array([0.6, 0, 0.0]), np.full(3, 8.0))
FAR = {ROOM_ID: box((90.0, 90.0, 90.0), (90.1, 90.1, 90.1), GREY)}  # trim, which every home has


def floor(size):
    return Surface(np.array([-size / 2, -size / 2, 0.0]), np.array([size, 0, 0]), np.array([0, size, 0.0]), GREY)


def lamp(height, side, radiance):
    corner = np.array([-side / 2, -side / 2, height])
    return AreaLight(corner, np.array([0, side, 0.0]), np.array([side, 0, 0.0]), np.full(3, radiance))


def test_small_lamp_follows_the_inverse_square_law():
    """Straight below a small lamp irradiance is radiance x area / height^2; the baker keeps it divided by pi."""
    lit = bake(Scene((floor(0.2),), FAR, (lamp(2.0, 0.1, 100.0),)), 0, BakeSettings(texel_m=0.02, bounces=0))
    middle = lit.surfaces[0].light[5, 5, :3]
    np.testing.assert_allclose(middle, 100.0 * 0.01 / 4.0 / np.pi, rtol=0.01)


def test_box_throws_a_shadow():
    solids = {1: box((-0.3, -0.3, 0.5), (0.3, 0.3, 0.6), GREY)} | FAR
    lit = bake(Scene((floor(3.0),), solids, (lamp(2.0, 0.1, 100.0),)), 0, BakeSettings(texel_m=0.1, bounces=0))
    light = lit.surfaces[0].light[..., 0]
    assert light[15, 15] < 1e-4
    # 1.25 m aside: radiance x area x cos^2 / r^2 / pi, with r^2 = 4 + 1.25^2 + 0.05^2.
    r2 = 4.0 + 1.25**2 + 0.05**2
    assert light[15, 2] == pytest.approx(100.0 * 0.01 * (4.0 / r2) / r2 / np.pi, rel=0.05)


def test_cosine_directions_have_a_cosine_density():
    """The mean of a cosine-weighted direction is 2/3 of the normal."""
    normal = np.array([0.36, -0.48, 0.8])
    samples = r2_sequence(4000)
    directions = cosine_directions(np.broadcast_to(normal, (4000, 3)), samples)
    np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1.0, atol=1e-9)
    np.testing.assert_allclose(directions.mean(axis=0), normal * 2.0 / 3.0, atol=5e-3)


def box_room(low, high, material=GREY):
    """Six surfaces that face inward."""
    low, size = np.asarray(low, dtype=float), np.asarray(high, dtype=float) - low
    x, y, z = np.diag(size)
    corners = [(low, x, y), (low + z, y, x), (low, y, z), (low + x, z, y), (low, z, x), (low + y, x, z)]
    return tuple(Surface(corner, u, v, material) for corner, u, v in corners)


def test_light_in_a_closed_grey_room_is_a_geometric_series():
    """All walls of a closed room with reflectance r that glow evenly see E = glow / (1 - r); here the first bounces
    of a lamp: with r = 0.5 every bounce adds half of what the last one brought, on average over the walls."""
    room = box_room((0.0, 0.0, 0.0), (2.0, 2.0, 2.0))
    light = AreaLight(np.array([0.8, 0.8, 1.98]), np.array([0, 0.4, 0.0]), np.array([0.4, 0, 0.0]), np.full(3, 10.0))
    sums = []
    for bounces in (0, 1, 2):
        lit = bake(Scene(room, FAR, (light,)), 0, BakeSettings(0.1, 0.2, lamp_samples=16, bounces=bounces))
        sums.append(sum(surface.light[..., :3].mean() for surface in lit.surfaces))
    # Power of the lamp: pi x radiance x area, kept divided by pi, over walls of 4 m2 each.
    assert sums[0] == pytest.approx(10.0 * 0.16 / 4.0, rel=0.05)
    assert sums[1] - sums[0] == pytest.approx(0.5 * sums[0], rel=0.05)
    assert sums[2] - sums[1] == pytest.approx(0.25 * sums[0], rel=0.07)


def test_no_light_leaks_through_a_wall_and_no_seam_runs_along_the_skirting():
    bright, dark = box_room((0.0, 0.0, 0.0), (3.0, 3.0, 2.5)), box_room((3.1, 0.0, 0.0), (6.0, 3.0, 2.5))
    trim = {ROOM_ID: box((0.0, 0.0, 0.0), (0.014, 3.0, 0.09), GREY)}
    lit = bake(Scene((*bright, *dark), trim, (CEILING,)), 0)
    assert max(surface.light[..., :3].max() for surface in lit.surfaces[6:]) < 1e-4
    wall = lit.surfaces[2].light[..., 0]
    rows = wall[:, 25:50].mean(axis=1)  # the wall at x = 0: u along y, v up
    # Behind the skirting (two texels) it is as bright as just above it, so that the filter finds no dark seam.
    assert rows[0] == pytest.approx(rows[4], rel=0.1)
    # Nor do rooms' corners turn dark: towards the edges light falls off gently.
    floor_map = lit.surfaces[0].light[..., 0]
    assert floor_map[0, 30] > 0.8 * floor_map[4, 30]


def test_one_seed_one_light_whatever_the_number_of_threads(monkeypatch):
    scene = Scene(box_room((0.0, 0.0, 0.0), (3.0, 3.0, 2.5)), FAR, (CEILING,))
    first = bake(scene, 3, BakeSettings.draft())
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {0})
    again = bake(scene, 3, BakeSettings.draft())
    for one, two in zip(first.surfaces, again.surfaces, strict=True):
        np.testing.assert_array_equal(one.light, two.light)
