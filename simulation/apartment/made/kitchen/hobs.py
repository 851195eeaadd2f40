"""What ovens have on top: gas, ceramic glass, coils or plates."""

from __future__ import annotations

import numpy as np

from edgemap.simulation.apartment.made.materials.plain import BLACK, GLASS, STEEL
from edgemap.simulation.apartment.made.shapes.bars import tube
from edgemap.simulation.apartment.made.shapes.lofts import lathe, loft
from edgemap.simulation.apartment.made.shapes.outlines import oval, raised
from edgemap.simulation.apartment.made.shapes.solids import block
from edgemap.simulation.render.mesh import Material, Mesh


def hob(rng: np.random.Generator, depth: float, half: float, height: float) -> list[Mesh]:
    """Gas burners under grates, ceramic glass with rings, coils or solid plates."""
    columns = 3 if half > 0.42 else 2
    ys = np.linspace(-half * 0.52, half * 0.52, columns) if columns == 2 else np.linspace(-half * 0.64, half * 0.64, 3)
    spots = [(depth * x, float(y)) for x in (0.34, 0.74) for y in ys]
    radii = [float(r) for r in rng.uniform(0.065, 0.1, len(spots))]
    way = str(rng.choice(["gas", "glass", "coil", "plate"], p=[0.4, 0.3, 0.15, 0.15]))
    meshes: list[Mesh] = []
    if way == "glass":
        meshes.append(block(depth * 0.53, 0.0, height - 0.001, depth * 0.86, half * 1.86, 0.006, GLASS))
        mark = Material((0.25, 0.25, 0.26))
        for (x, y), r in zip(spots, radii, strict=True):
            meshes.append(_rings(x, y, height + 0.0055, (r, r * 0.62), 0.003, mark))
        return meshes
    if way == "plate":
        iron = Material((0.04, 0.04, 0.042), gloss=0.1)
        for (x, y), r in zip(spots, radii, strict=True):
            meshes.append(
                Mesh(
                    (
                        lathe(np.array([r + 0.006, r + 0.006, r]), np.array([0.0, 0.006, 0.007]) + height, STEEL).moved(
                            np.eye(3), np.array([x, y, 0.0])
                        ),
                    )
                )
            )
            meshes.append(loft([raised(oval(2 * r, 2 * r, points=20), x, y, height + z) for z in (0.0, 0.016)], iron))
        return meshes
    if way == "coil":
        for (x, y), r in zip(spots, radii, strict=True):
            meshes.append(_rings(x, y, height + 0.0005, (r + 0.008,), r + 0.004, STEEL))
            meshes.append(_rings(x, y, height + 0.012, (r, r * 0.76, r * 0.52, r * 0.28), 0.011, BLACK))
        return meshes
    tray = BLACK if rng.random() < 0.5 else STEEL
    meshes.append(block(depth * 0.53, 0.0, height - 0.001, depth * 0.84, half * 1.84, 0.003, tray))
    iron, up = Material((0.012, 0.012, 0.012)), float(rng.uniform(0.02, 0.035))
    for (x, y), r in zip(spots, radii, strict=True):
        meshes.append(tube((x, y, height), (x, y, height + 0.012), r * 0.5, STEEL))
        meshes.append(tube((x, y, height + 0.012), (x, y, height + 0.018), r * 0.42, BLACK))
        for turn in (0.0, np.pi / 2):
            long = 0.13 if turn else 0.115
            a, b = (0.01, 2 * min(long, half * 0.8 / columns)) if turn else (2 * min(long, depth * 0.19), 0.01)
            meshes.append(block(x, y, height + up, a, b, 0.01, iron))
            for sign in (-1, 1):
                meshes.append(
                    block(
                        x + sign * (a / 2 - 0.005) * (not turn),
                        y + sign * (b / 2 - 0.005) * bool(turn),
                        height,
                        0.01,
                        0.01,
                        up + 0.001,
                        iron,
                    )
                )
    if rng.random() < 0.6:
        for y in ys:
            for dx in (-0.42, 0.42):
                meshes.append(
                    block(
                        depth * 0.54 + dx * depth * 0.88, float(y), height + up, 0.01, half * 1.7 / columns, 0.01, iron
                    )
                )
            for dy in (-0.85, 0.85):
                meshes.append(
                    block(depth * 0.54, float(y) + dy * half / columns, height + up, depth * 0.75, 0.01, 0.01, iron)
                )
    return meshes


def _rings(x: float, y: float, z: float, radii: tuple[float, ...], width: float, material: Material) -> Mesh:
    """Flat rings with their outer radii and one width, on the level."""
    parts = []
    for radius in radii:
        inner = max(radius - width, 0.001)
        rise = np.array([z, z + 1e-4])
        flat = lathe(np.array([radius, inner]), rise, material, sides=24)
        parts.append(flat.moved(np.eye(3), np.array([x, y, 0.0])))
    return Mesh(tuple(parts))
