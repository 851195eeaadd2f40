"""One small lit room for all tests of the simulation; skipped where the extra, the furniture or OpenGL is missing."""

import pytest

from edgemap.geometry.errors import EdgemapError


@pytest.fixture(scope="session")
def furniture_catalogue():
    from edgemap.simulation import furniture

    try:
        return furniture.catalogue()
    except EdgemapError as error:
        pytest.skip(str(error))


@pytest.fixture(scope="session")
def world(furniture_catalogue):
    """(room, lit scene) of seed 5 with coarse light."""
    pytest.importorskip("embreex")
    pytest.importorskip("PIL")
    from edgemap.simulation.light import BakeSettings, bake
    from edgemap.simulation.room import furnish
    from edgemap.simulation.world import build_scene

    room = furnish(5)
    settings = BakeSettings(texel_m=0.1, vertex_spacing_m=0.3, lamp_samples=2, hemisphere_samples=4, bounces=1)
    return room, bake(build_scene(room, 5), 5, settings)


@pytest.fixture(scope="session")
def renderer(world):
    pytest.importorskip("moderngl")
    from edgemap.simulation.renderer import Renderer
    from edgemap.simulation.world import CameraSetup

    try:
        made = Renderer(world[1], CameraSetup().intrinsics, exposure=1.9)
    except EdgemapError as error:
        pytest.skip(str(error))
    yield made
    made.close()
