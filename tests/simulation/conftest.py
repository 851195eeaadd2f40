"""One home, lit once, for all tests of the simulation; skipped where the extra, the furniture or OpenGL is missing."""

import pytest

from edgemap.geometry.errors import EdgemapError


@pytest.fixture(scope="session")
def furniture_catalogue():
    from edgemap.simulation.apartment import furniture

    try:
        return furniture.catalogue()
    except EdgemapError as error:
        pytest.skip(str(error))


@pytest.fixture(scope="session")
def drawn(furniture_catalogue):
    """A world of five pictures, with a person."""
    from edgemap.simulation.world import Choices, draw_world

    return draw_world(9107, 5, Choices(people=1, contract=False))


@pytest.fixture(scope="session")
def lit(drawn):
    """The home of `drawn` with its light, coarsely: in a second or two."""
    for module in ("moderngl", "embreex", "PIL"):
        pytest.importorskip(module)
    from edgemap.simulation.render.light import BakeSettings
    from edgemap.simulation.studio import lit_home

    coarse = BakeSettings(texel_m=0.3, vertex_spacing_m=1.0, lamp_samples=1, hemisphere_samples=2, bounces=1)
    return lit_home(drawn, coarse)
