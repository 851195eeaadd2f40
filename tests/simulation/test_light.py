import numpy as np
import pytest

from edgemap.simulation.render.mesh import Material, quad, subdivided
from edgemap.simulation.render.scene import AreaLight, Scene, Surface

pytest.importorskip("embreex")

from edgemap.simulation.render.light import BakeSettings, bake
from edgemap.simulation.render.raytracer import cosine_directions, r2_sequence

GREY = Material((0.5, 0.5, 0.5))


def floor(size):
    return Surface(np.array([-size / 2, -size / 2, 0.0]), np.array([size, 0, 0]), np.array([0, size, 0.0]), GREY)


def lamp(height, side, radiance):
    corner = np.array([-side / 2, -side / 2, height])
    return AreaLight(corner, np.array([0, side, 0.0]), np.array([side, 0, 0.0]), np.full(3, radiance))


def test_small_lamp_follows_the_inverse_square_law():
    """Straight below a small lamp irradiance is radiance x area / height^2; the baker keeps it divided by pi."""
    lit = bake(Scene((floor(0.2),), (), (lamp(2.0, 0.1, 100.0),)), 0, BakeSettings(texel_m=0.02, bounces=0))
    middle = lit.surfaces[0][1][5, 5]
    np.testing.assert_allclose(middle, 100.0 * 0.01 / 4.0 / np.pi, rtol=0.01)


def test_box_throws_a_shadow():
    from edgemap.simulation.render.mesh import box
    from edgemap.simulation.render.scene import Solid

    block = Solid(1, box((-0.3, -0.3, 0.5), (0.3, 0.3, 0.6), GREY))
    lit = bake(Scene((floor(3.0),), (block,), (lamp(2.0, 0.1, 100.0),)), 0, BakeSettings(texel_m=0.1, bounces=0))
    light = lit.surfaces[0][1][..., 0]
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


def test_subdivided_part_of_a_solid_is_lit_on_the_side_of_the_lamp():
    from edgemap.simulation.render.mesh import Mesh
    from edgemap.simulation.render.scene import Solid

    sheet = Solid(1, Mesh((subdivided(quad((-0.2, -0.2, 1), (0.4, 0, 0), (0, 0.4, 0), GREY), 0.1),)))
    lit = bake(Scene((), (sheet,), (lamp(2.0, 0.1, 100.0),)), 0, BakeSettings(bounces=0))
    assert lit.parts[0].front.min() > 0.1
    assert lit.parts[0].back.max() == 0.0
