"""One small lit room for all tests of the simulation; skipped where the extra, the furniture or OpenGL is missing."""

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
def world(furniture_catalogue):
    """(apartment, lit scene) of seed 5 with coarse light."""
    pytest.importorskip("embreex")
    pytest.importorskip("PIL")
    from edgemap.simulation.apartment.apartment import furnish
    from edgemap.simulation.render.light import BakeSettings, bake
    from edgemap.simulation.world import build_scene

    apartment = furnish(5)
    settings = BakeSettings(texel_m=0.1, vertex_spacing_m=0.3, lamp_samples=2, hemisphere_samples=4, bounces=1)
    return apartment, bake(build_scene(apartment, 5), 5, settings)


@pytest.fixture(scope="session")
def renderer(world):
    pytest.importorskip("moderngl")
    from edgemap.simulation.render.renderer import Renderer
    from edgemap.simulation.world import CameraSetup

    try:
        made = Renderer(world[1], CameraSetup().intrinsics, exposure=1.9)
    except EdgemapError as error:
        pytest.skip(str(error))
    yield made
    made.close()
