"""The bare room: floor, walls with skirting, ceiling, window, lamp, rug and painting, with the light they give."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from edgemap.simulation.apartment import textures
from edgemap.simulation.render.mesh import Array, Material, Mesh, box, quad
from edgemap.simulation.render.scene import ROOM_ID, AreaLight, Solid, Surface

Colour = tuple[float, float, float]

_TRIM = Material((0.78, 0.77, 0.74), gloss=0.08)
_SKIRTING_HEIGHT_M, _SKIRTING_DEPTH_M = 0.09, 0.014
_RUG_HEIGHT_M = 0.006


@dataclass(frozen=True, slots=True)
class Opening:
    """A rectangle on the far wall (y = depth): from x to x + width and z to z + height, metres."""

    x_m: float
    z_m: float
    width_m: float
    height_m: float


@dataclass(frozen=True, slots=True)
class Shell:
    """A rectangular room: x from 0 to width, y from 0 to depth, z up from the floor; metres, colours sRGB 0..255.

    rug: x, y of its low corner and its width and depth, or None. window, painting: on the far wall (y = depth).
    """

    width_m: float
    depth_m: float
    height_m: float = 2.55
    floor_rgb: Colour = (184.0, 140.0, 98.0)
    wall_rgb: Colour = (214.0, 211.0, 200.0)
    rug: tuple[float, float, float, float] | None = None
    rug_rgb: tuple[Colour, ...] = ((132.0, 62.0, 52.0), (206.0, 190.0, 160.0), (62.0, 74.0, 98.0))
    window: Opening | None = None
    painting: Opening | None = None
    lamp_radiance: Colour = (8.0, 7.4, 6.4)
    sky_radiance: Colour = (5.2, 5.6, 6.0)


@dataclass(frozen=True, slots=True, eq=False)
class ShellParts:
    """What a shell adds to a scene."""

    surfaces: tuple[Surface, ...]
    solids: tuple[Solid, ...]
    lights: tuple[AreaLight, ...]


def build_shell(shell: Shell, rng: np.random.Generator) -> ShellParts:
    """Surfaces, trim and lights of a room."""
    lamp, lamp_mesh = _lamp(shell)
    lights, meshes = [lamp], [lamp_mesh, _skirting(shell)]
    if shell.window is not None:
        light, mesh = _window(shell, shell.window, rng)
        lights.append(light)
        meshes.append(mesh)
    if shell.painting is not None:
        meshes.append(_painting(shell, shell.painting, rng))
    return ShellParts(_surfaces(shell, rng), tuple(Solid(ROOM_ID, mesh) for mesh in meshes), tuple(lights))


def _surfaces(shell: Shell, rng: np.random.Generator) -> tuple[Surface, ...]:
    wood = Material((1.0, 1.0, 1.0), textures.planks(rng, shell.floor_rgb), gloss=0.10)
    wall = Material((1.0, 1.0, 1.0), textures.paint(rng, shell.wall_rgb))
    ceiling = Material((0.84, 0.84, 0.82))
    x, y, z = np.diag([shell.width_m, shell.depth_m, shell.height_m])
    surfaces = [
        Surface(np.zeros(3), x, y, wood, (1.9, 1.9)),
        Surface(z, y, x, ceiling),
        Surface(x, -x, z, wall),
        Surface(np.zeros(3), y, z, wall),
        Surface(y, x, z, wall),
        Surface(x + y, -y, z, wall),
    ]
    if shell.rug is not None:
        surfaces.append(_rug(shell.rug, textures.rug(rng, shell.rug_rgb)))
    return tuple(surfaces)


def _rug(rug: tuple[float, float, float, float], texture: textures.Texture) -> Surface:
    """A rug just above the floor; its texture covers it once (cut to its proportions)."""
    left, near, width, depth = rug
    length = max(width, depth)
    rows = max(1, round(texture.shape[0] * min(width, depth) / length))
    shape = (rows, texture.shape[1]) if width >= depth else (texture.shape[0], rows)
    at = (np.arange(n) * m // n for n, m in zip(shape, texture.shape[:2], strict=True))
    fitted = np.ascontiguousarray(texture[np.ix_(*at)])
    corner = np.array([left, near, _RUG_HEIGHT_M])
    return Surface(
        corner,
        np.array([width, 0.0, 0.0]),
        np.array([0.0, depth, 0.0]),
        Material((1.0, 1.0, 1.0), fitted),
        (width, depth),
    )


def _skirting(shell: Shell) -> Mesh:
    width, depth, top, thick = shell.width_m, shell.depth_m, _SKIRTING_HEIGHT_M, _SKIRTING_DEPTH_M
    boxes = [
        box((0, 0, 0), (width, thick, top), _TRIM),
        box((0, depth - thick, 0), (width, depth, top), _TRIM),
        box((0, 0, 0), (thick, depth, top), _TRIM),
        box((width - thick, 0, 0), (width, depth, top), _TRIM),
    ]
    return _joined(boxes)


def _lamp(shell: Shell) -> tuple[AreaLight, Mesh]:
    """A square ceiling panel in the middle of the room, a little above its rim."""
    half, bottom = 0.4, shell.height_m - 0.06
    centre = np.array([shell.width_m / 2.0, shell.depth_m / 2.0, bottom])
    corner = centre - [half, half, 0.0]
    u, v = np.array([0.0, 2.0 * half, 0.0]), np.array([2.0 * half, 0.0, 0.0])
    glow = Material((0.0, 0.0, 0.0), emission=shell.lamp_radiance)
    rim = box(corner + [-0.02, -0.02, 0.005], centre + [half + 0.02, half + 0.02, 0.06], _TRIM)
    light = AreaLight(corner - [0.0, 0.0, 0.002], u, v, np.array(shell.lamp_radiance))
    return light, Mesh((quad(corner, u, v, glow), *rim.parts))


def _window(shell: Shell, hole: Opening, rng: np.random.Generator) -> tuple[AreaLight, Mesh]:
    """A bright pane with a white frame and sill on the far wall."""
    y, rim = shell.depth_m, 0.06
    low, size = np.array([hole.x_m, y - 0.012, hole.z_m]), (hole.width_m, hole.height_m)
    u, v = np.array([size[0], 0.0, 0.0]), np.array([0.0, 0.0, size[1]])
    view = textures.outdoors(rng)
    pane = quad(low, u, v, Material((0.0, 0.0, 0.0), view, emission=(0.9, 0.95, 1.0)), size)
    x0, x1, z0, z1 = hole.x_m, hole.x_m + size[0], hole.z_m, hole.z_m + size[1]
    bars = [
        ((x0 - rim, z0 - rim), (x1 + rim, z0)),
        ((x0 - rim, z1), (x1 + rim, z1 + rim)),
        ((x0 - rim, z0), (x0, z1)),
        ((x1, z0), (x1 + rim, z1)),
        ((x0 + size[0] / 2 - 0.025, z0), (x0 + size[0] / 2 + 0.025, z1)),
    ]
    frame = [box((a[0], y - 0.05, a[1]), (b[0], y, b[1]), _TRIM) for a, b in bars]
    sill = box((x0 - 0.12, y - 0.16, z0 - rim - 0.03), (x1 + 0.12, y, z0 - rim), _TRIM)
    light = AreaLight(low - [0.0, 0.05, 0.0], u, v, np.array(shell.sky_radiance))
    return light, _joined([Mesh((pane,)), *frame, sill])


def _painting(shell: Shell, at: Opening, rng: np.random.Generator) -> Mesh:
    y, rim = shell.depth_m, 0.03
    canvas = quad(
        (at.x_m, y - 0.025, at.z_m),
        (at.width_m, 0.0, 0.0),
        (0.0, 0.0, at.height_m),
        Material((1.0, 1.0, 1.0), textures.landscape(rng)),
        (at.width_m, at.height_m),
    )
    wood = Material((0.05, 0.03, 0.02), gloss=0.2)
    low: Array = np.array([at.x_m - rim, y - 0.02, at.z_m - rim])
    high = np.array([at.x_m + at.width_m + rim, y, at.z_m + at.height_m + rim])
    return _joined([Mesh((canvas,)), box(low, high, wood)])


def _joined(meshes: list[Mesh]) -> Mesh:
    return Mesh(tuple(part for mesh in meshes for part in mesh.parts))
