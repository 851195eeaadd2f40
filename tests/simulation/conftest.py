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
def light_coarsely():
    """light_coarsely(world) -> its lit home, in a second or two."""
    for module in ("moderngl", "embreex", "PIL"):
        pytest.importorskip(module)
    from edgemap.simulation import studio
    from edgemap.simulation.render.light import BakeSettings, bake

    coarse = BakeSettings(texel_m=0.3, vertex_spacing_m=1.0, lamp_samples=1, hemisphere_samples=2, bounces=1)

    def light(world):
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(studio, "bake", lambda scene, seed, _: bake(scene, seed, coarse))
            return studio.lit_home(world)

    return light


@pytest.fixture(scope="session")
def lit(drawn, light_coarsely):
    """The home of `drawn` with its light."""
    return light_coarsely(drawn)


@pytest.fixture(scope="session")
def renderer(lit):
    from edgemap.simulation.render.renderer import Renderer
    from edgemap.simulation.world import CameraSetup

    try:
        made = Renderer(lit, CameraSetup().intrinsics)
    except EdgemapError as error:
        pytest.skip(str(error))
    yield made
    made.close()
