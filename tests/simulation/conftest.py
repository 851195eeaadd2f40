"""One home, lit once, for all tests of the simulation; skipped where the extra, the furniture or OpenGL is missing."""

import pytest

pytest.importorskip("moderngl", reason="needs the extra edgemap-robot[simulation]")
pytest.importorskip("embreex", reason="needs the extra edgemap-robot[simulation]")

from edgemap.geometry.errors import EdgemapError
from edgemap.simulation.apartment import furniture
from edgemap.simulation.render.light import BakeSettings
from edgemap.simulation.studio import lit_home
from edgemap.simulation.world import Choices, draw_world


@pytest.fixture(scope="session")
def furniture_catalogue():
    try:
        return furniture.catalogue()
    except EdgemapError as error:
        pytest.skip(str(error))


@pytest.fixture(scope="session")
def drawn(furniture_catalogue):
    """A world of five pictures, with a person."""
    return draw_world(9107, 5, Choices(people=1, contract=False))


@pytest.fixture(scope="session")
def lit(drawn):
    """The home of `drawn` with its light, coarsely: in a second or two."""
    coarse = BakeSettings(texel_m=0.3, vertex_spacing_m=1.0, lamp_samples=1, hemisphere_samples=2, bounces=1)
    return lit_home(drawn, coarse)
