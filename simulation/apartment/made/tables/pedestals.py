"""Tables on columns and on stars of bars."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import PchipInterpolator

from edgemap.simulation.apartment.made.shapes.bars import beam, rod
from edgemap.simulation.apartment.made.shapes.lofts import lathe, plate
from edgemap.simulation.apartment.made.shapes.outlines import oval, rectangle
from edgemap.simulation.apartment.made.tables.table import Table
from edgemap.simulation.render.mesh import Array, Material, Mesh

_X = (1.0, 0.0, 0.0)


def pedestal(rng: np.random.Generator, table: Table) -> list[Mesh]:
    """A column in the middle, two under a long top: turned, plain, a tulip or a drum; on a plate or on feet."""
    long = table.width > 1.5 * table.depth
    places = (-table.width / 4.2, table.width / 4.2) if long else (0.0,)
    reach = min(table.depth, table.width) * float(rng.uniform(0.26, 0.36))
    style, meshes = rng.random(), []
    up = np.linspace(0.0, 1.0, 24)
    thin = float(rng.uniform(0.035, 0.07))
    if style < 0.25:  # A tulip's trumpet.
        radius = PchipInterpolator(
            [0.0, 0.02, 0.1, 0.45, 0.85, 1.0], [reach, reach, reach * 0.5, thin, thin, reach * 0.4]
        )
    elif style < 0.35:  # A drum or a cone.
        radius = PchipInterpolator([0.0, 0.5, 1.0], reach * rng.uniform(0.55, 1.0, 3))
    elif style < 0.7:
        radius = PchipInterpolator([0.0, 0.08, 0.2, 0.35, 0.55, 0.8, 0.9, 1.0], thin * rng.uniform(0.8, 2.0, 8))
    else:
        radius = PchipInterpolator([0.0, 0.5, 1.0], [thin, thin, thin])
    feet = 0 if style < 0.35 else int(rng.choice([0, 0, 3, 4, 4]))
    lift = 0.08 if feet else 0.0
    for y in places:
        column = lathe(radius(up), lift + up * (table.under - lift), table.feet)
        meshes.append(Mesh((column,)).placed(0.0, y, 0.0, 0.0))
        start = float(rng.uniform(0.0, np.pi)) if feet == 3 else (0.0 if rng.random() < 0.5 else np.pi / 4)
        for turn in start + np.arange(feet) * 2.0 * np.pi / max(feet, 1):
            way = np.array([np.cos(turn), np.sin(turn), 0.0])
            hip, knee, toe = (0.24, 0.17, 0.03)
            path = [way * r + [0.0, y, z] for r, z in ((0.02, hip), (reach * 0.5, knee), (reach * 1.15, toe))]
            meshes.append(_curved(path, (0.045, 0.03), table.feet))
        if not feet and style >= 0.35:
            base = (
                oval(2 * reach, 2 * reach, points=40)
                if table.round_ or rng.random() < 0.6
                else rectangle(1.8 * reach, 1.8 * reach)
            )
            meshes.append(plate(base, 0.0, float(rng.uniform(0.012, 0.04)), table.feet).placed(0.0, y, 0.0, 0.0))
    if style < 0.35 and table.top.opacity == 1.0:
        return meshes
    inner = plate(oval(reach * 1.4, reach * 1.4, points=40), table.under - 0.025, table.under, table.feet)
    return meshes + [inner.placed(0.0, y, 0.0, 0.0) for y in places]


def _curved(path: list[Array], radii: tuple[float, float], material: Material) -> Mesh:
    """A foot bent through three points, tapering, its toe rounded off."""
    t = np.linspace(0.0, 1.0, 8)[:, None]
    points = (1 - t) ** 2 * path[0] + 2 * t * (1 - t) * (path[1] + [0.0, 0.0, 0.05]) + t**2 * path[2]
    radius = np.linspace(*radii, 8)
    radius[-1] = 0.004
    return rod(points, radius, material, sides=10, ends=False)


def spider(rng: np.random.Generator, table: Table) -> list[Mesh]:
    """Slanted bars from the middle of the floor or of the top outwards: a star, a cross or a butterfly."""
    count, size = int(rng.choice([3, 4, 4, 4])), float(rng.uniform(0.025, 0.07))
    meshes, inward = [], rng.random() < 0.5
    for turn in np.pi / 4 + np.arange(count) * 2.0 * np.pi / count:
        way = np.array([np.cos(turn) * table.depth, np.sin(turn) * table.width, 0.0]) * 0.4
        near, far = way * 0.12, way
        foot, head = (far, near) if inward else (near, far * 0.9)
        far_through = head + [0.0, 0.0, table.under]
        meshes.append(beam(foot, far_through, (size, size), table.feet, across=_X, level=True))
    hub = 0.09 if inward else 0.07
    z = table.under - 0.03 if inward else 0.0
    meshes.append(plate(oval(4 * hub, 4 * hub, points=40), z, z + 0.03, table.feet))
    return meshes
