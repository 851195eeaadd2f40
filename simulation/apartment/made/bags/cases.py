"""Luggage that is no hard trolley: duffels, trunks, briefcases, suitcases of cloth and of leather."""

from __future__ import annotations

import numpy as np

from edgemap.simulation.apartment.made.bags.backpacks import ZIP
from edgemap.simulation.apartment.made.materials.cloths import bag_cloth, fabric
from edgemap.simulation.apartment.made.materials.plain import BLACK, BRASS, STEEL, drawn_colour
from edgemap.simulation.apartment.made.shapes.bars import rod, tube
from edgemap.simulation.apartment.made.shapes.lofts import loft
from edgemap.simulation.apartment.made.shapes.outlines import arc, rectangle
from edgemap.simulation.apartment.made.shapes.placing import joined
from edgemap.simulation.apartment.made.shapes.solids import block, cushion, rounded
from edgemap.simulation.render.mesh import Material, Mesh, box


def other_luggage(rng: np.random.Generator) -> Mesh:
    """Any luggage but a hard trolley."""
    makers = (_soft_trolley, _duffel, _trunk, _briefcase, _old_suitcase)
    return makers[int(rng.choice(5, p=[0.34, 0.18, 0.14, 0.12, 0.22]))](rng)


def _soft_trolley(rng: np.random.Generator) -> Mesh:
    """An upright trolley of cloth: piped edges, pockets in front, wheels, a handle drawn out or not."""
    width, height = float(rng.uniform(0.34, 0.5)), float(rng.uniform(0.48, 0.74))
    depth, foot = width * float(rng.uniform(0.5, 0.68)), float(rng.uniform(0.02, 0.055))
    cloth, trim = bag_cloth(rng), BLACK if rng.random() < 0.7 else Material(drawn_colour(rng, 0.7))
    x, y, top = depth / 2, width / 2, foot + height
    radius = float(rng.uniform(0.03, 0.08))
    meshes = [rounded((-x, -y, foot), (x, y, top), cloth, radius, float(rng.uniform(0.012, 0.03)), axis=0)]
    outline = rectangle(width - 0.012, height - 0.012, radius - 0.004, steps=6)
    for at_x in (-x + 0.012, x - 0.012):
        edge = np.concatenate([np.full((len(outline), 1), at_x), outline + [0.0, foot + height / 2]], axis=1)
        meshes.append(rod(edge, 0.009, trim, sides=6, across=(1.0, 0.0, 0.0), closed=True))
    low = foot + 0.05
    for _ in range(int(rng.integers(1, 3))):
        tall = (top - low) * float(rng.uniform(0.45, 0.8))
        thick, wide = float(rng.uniform(0.03, 0.06)), width * float(rng.uniform(0.72, 0.88))
        meshes.append(rounded((x - 0.01, -wide / 2, low), (x + thick, wide / 2, low + tall), cloth, 0.04, 0.02, axis=0))
        meshes.append(block(x + thick - 0.002, 0.0, low + tall - 0.05, 0.006, wide * 0.8, 0.01, ZIP))
        low += tall + 0.015
        if top - low < 0.14:
            break
    for at_x in (-x + 0.04, x - 0.04):
        for at_y in (-y + 0.045, y - 0.045):
            meshes.append(tube((at_x, at_y - 0.014, 0.024), (at_x, at_y + 0.014, 0.024), 0.024, BLACK))
            meshes.append(block(at_x, at_y, 0.024, 0.035, 0.034, max(foot - 0.01, 0.01), BLACK))
    meshes.append(_grip(top - 0.006, 0.08, 0.035, (0.014, 0.006), trim))
    if rng.random() < 0.45:
        up, back = top + float(rng.uniform(0.2, 0.4)), -x + 0.03
        meshes += [tube((back, s, top - 0.03), (back, s, up), 0.008, STEEL) for s in (-0.1, 0.1)]
        meshes.append(
            rounded((back - 0.014, -0.12, up - 0.005), (back + 0.014, 0.12, up + 0.025), BLACK, 0.01, 0.006, axis=1)
        )
    return joined(meshes)


def _duffel(rng: np.random.Generator) -> Mesh:
    """A soft bag lying along y: a drum with flat underside, zip on top, two handles, bands round it."""
    long, tall = float(rng.uniform(0.45, 0.68)), float(rng.uniform(0.24, 0.33))
    deep = tall * float(rng.uniform(0.9, 1.15))
    cloth, strap = bag_cloth(rng), BLACK if rng.random() < 0.6 else Material(drawn_colour(rng, 0.8))
    turn = np.arange(28) * 2 * np.pi / 28
    c, s = np.cos(turn), np.sin(turn)
    power = np.where(c < 0.0, 0.5, 0.85)
    # Columns z, x so that the ring goes round counter-clockwise about y.
    section = np.stack([np.sign(c) * np.abs(c) ** power * tall / 2, np.sign(s) * np.abs(s) ** 0.75 * deep / 2], axis=1)
    section = np.concatenate([section, section[:1]])
    rows = [(-1.0, 0.84), (-0.985, 0.92), (-0.94, 0.98), (-0.8, 1.0), (0.0, float(rng.uniform(0.94, 1.04)))]
    rows += [(-y, size) for y, size in rows[-2::-1]]
    rings = []
    for y, size in rows:
        ring = np.empty((len(section), 3))
        ring[:, 0], ring[:, 1] = section[:, 1] * size, y * long / 2
        ring[:, 2] = section[:, 0] * size + tall / 2 * min(size, 1.0)
        rings.append(ring)
    meshes = [loft(rings, cloth)]
    meshes.append(block(0.0, 0.0, tall * 0.985, 0.018, long * 0.8, tall * 0.02 + 0.003, ZIP))
    for y in (-long * 0.2, long * 0.2):
        half = section * 1.015
        ring = np.stack([half[:, 1], np.full(len(half), y), half[:, 0] + tall / 2], axis=1)
        rim = np.stack([ring + [0, -0.018, 0], ring + [0, 0.018, 0]])
        meshes.append(loft(rim, strap, low=False, high=False))
    for side in (-1.0, 1.0):
        up, x = float(rng.uniform(0.07, 0.16)), side * deep * 0.24
        bow = arc((x, -long * 0.2, tall * 0.93), (x, long * 0.2, tall * 0.93), (side * 0.02, 0.0, up), 13)
        meshes.append(rod(bow, 0.014, strap, 0.006 / 0.014, across=(1.0, 0.0, -side * 0.2)))
    if rng.random() < 0.6:
        meshes.append(cushion((deep * 0.46, 0.0, tall * 0.42), (0.05, long * 0.34, tall * 0.5), cloth, 5.0))
    return joined(meshes)


def _trunk(rng: np.random.Generator) -> Mesh:
    """A chest for travels: flat lid, metal or leather corners, bands, clasps, handles at the ends."""
    long, deep, tall = float(rng.uniform(0.55, 0.85)), float(rng.uniform(0.32, 0.46)), float(rng.uniform(0.26, 0.42))
    body = Material(drawn_colour(rng, 0.7), gloss=0.15) if rng.random() < 0.6 else fabric(rng)
    metal = BRASS if rng.random() < 0.6 else STEEL
    x, y, seam = deep / 2, long / 2, tall * float(rng.uniform(0.62, 0.75))
    meshes = [
        box((-x, -y, 0.0), (x, y, seam - 0.002), body),
        box((-x + 0.003, -y + 0.003, seam - 0.003), (x - 0.003, y - 0.003, seam + 0.003), BLACK),
        rounded((-x, -y, seam + 0.002), (x, y, tall), body, 0.006, 0.006),
    ]
    for z in (seam - 0.02, seam + 0.004):
        meshes.append(box((-x - 0.003, -y - 0.003, z), (x + 0.003, y + 0.003, z + 0.016), metal))
    for at_x in (-x, x):
        for at_y in (-y, y):
            for z in (0.0, tall - 0.045):
                corner = np.array([at_x, at_y, z])
                low = corner - [0.045 if at_x > 0 else 0.004, 0.045 if at_y > 0 else 0.004, 0.0]
                meshes.append(box(low, low + [0.049, 0.049, 0.048], metal))
    for at_y in [-y * 0.5, y * 0.5] if rng.random() < 0.6 else [-y * 0.6, 0.0, y * 0.6]:
        meshes.append(
            rounded((x, at_y - 0.025, seam - 0.05), (x + 0.014, at_y + 0.025, seam + 0.035), metal, 0.01, 0.004, axis=0)
        )
    for side in (-1.0, 1.0):
        bow = arc((-0.07, side * y, tall * 0.45), (0.07, side * y, tall * 0.45), (0.0, side * 0.035, -0.02))
        meshes.append(rod(bow, 0.008, BLACK, across=(0.0, 0.2, 1.0)))
    if rng.random() < 0.5:
        wood_band = Material((0.25, 0.13, 0.05), gloss=0.1)
        for at_y in (-y * 0.33, y * 0.33):
            meshes.append(box((-x - 0.006, at_y - 0.02, 0.0), (x + 0.006, at_y + 0.02, tall + 0.006), wood_band))
    return joined(meshes)


def _case(rng: np.random.Generator, size: tuple[float, float, float], shell: Material, metal: Material) -> list[Mesh]:
    """An upright case (depth, width, height): two halves, a seam along the middle, grip and two locks on top."""
    depth, width, height = size
    x, y = depth / 2, width / 2
    radius = float(rng.uniform(0.015, 0.06))
    meshes = [rounded((-x, -y, 0.0), (x, y, height), shell, radius, float(rng.uniform(0.006, 0.02)), axis=0)]
    meshes.append(rounded((-0.006, -y - 0.003, 0.0), (0.006, y + 0.003, height + 0.003), metal, radius, 0.002, axis=0))
    grip = BLACK if rng.random() < 0.5 else shell
    meshes.append(_grip(height - 0.004, 0.07, 0.05, (0.012, 0.008), grip))
    for at_y in (-width * 0.3, width * 0.3):
        meshes.append(block(0.0, at_y, height - 0.001, 0.05, 0.045, 0.009, metal))
    return meshes


def _grip(z: float, half: float, rise: float, size: tuple[float, float], material: Material) -> Mesh:
    """A bow on top, along y from -half to half, as high as it rises; size: half its width and half its thickness."""
    wide, thin = size
    bow = arc((0.0, -half, z), (0.0, half, z), (0.0, 0.0, rise))
    return rod(bow, wide, material, thin / wide, across=(1.0, 0.0, 0.0))


def _briefcase(rng: np.random.Generator) -> Mesh:
    """A slim case for papers, of leather or metal."""
    metal = BRASS if rng.random() < 0.5 else STEEL
    value = float(rng.uniform(0.015, 0.1))
    leather = Material((value * float(rng.uniform(1.0, 2.5)), value * 1.1, value), gloss=0.2)
    shell = Material((0.5, 0.5, 0.52), gloss=0.5) if rng.random() < 0.25 else leather
    size = (float(rng.uniform(0.08, 0.14)), float(rng.uniform(0.38, 0.47)), float(rng.uniform(0.27, 0.34)))
    return joined(_case(rng, size, shell, metal))


def _old_suitcase(rng: np.random.Generator) -> Mesh:
    """A suitcase carried by a grip on its long side: leather or card, corners and belts, or moulded and plain."""
    width = float(rng.uniform(0.48, 0.75))
    height, depth = width * float(rng.uniform(0.6, 0.75)), float(rng.uniform(0.16, 0.25))
    shell = Material(drawn_colour(rng, 0.8), gloss=float(rng.uniform(0.05, 0.3))) if rng.random() < 0.7 else fabric(rng)
    meshes = _case(rng, (depth, width, height), shell, BRASS if rng.random() < 0.5 else STEEL)
    leather = Material((0.13, 0.06, 0.025), gloss=0.2)
    x, y = depth / 2, width / 2
    if rng.random() < 0.6:
        for at_y in (-y + 0.03, y - 0.03):
            for z in (0.0, height - 0.064):
                low = (-x - 0.004, at_y - 0.034, z - 0.002 if z == 0.0 else z)
                meshes.append(rounded(low, (x + 0.004, at_y + 0.034, z + 0.068), leather, 0.03, 0.008, axis=0))
    if rng.random() < 0.5:
        for at_y in (-width * 0.24, width * 0.24):
            meshes.append(box((-x - 0.004, at_y - 0.018, -0.003), (x + 0.004, at_y + 0.018, height + 0.004), leather))
            meshes.append(block(x + 0.004, at_y, height * 0.8, 0.008, 0.05, 0.04, BRASS))
    return joined(meshes)
