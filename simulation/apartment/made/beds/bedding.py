"""What lies in a bed: mattress, pillows, duvet, blanket and throw."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from edgemap.simulation.apartment.made.materials.cloths import fabric, linen
from edgemap.simulation.apartment.made.shapes.grids import surface
from edgemap.simulation.apartment.made.shapes.placing import turned
from edgemap.simulation.apartment.made.shapes.solids import cushion
from edgemap.simulation.apartment.textures import noise
from edgemap.simulation.render.mesh import Material, Mesh, Part


@dataclass(frozen=True, slots=True)
class BedFrame:
    """Metres. length, width: of the mattress, its middle at the origin; low, high: heights of its faces."""

    length: float
    width: float
    low: float
    high: float
    material: Material

    @property
    def back(self) -> float:
        """Where the headboard's front is, x."""
        return -self.length / 2.0 - 0.01


def bedding(rng: np.random.Generator, frame: BedFrame) -> list[Mesh]:
    """Mattress, pillows, duvet or blanket drawn up or pulled back, a throw over the foot."""
    sheet = linen(rng)
    height = frame.high - frame.low
    middle = (0.0, 0.0, frame.low + height / 2)
    meshes = [cushion(middle, (frame.length, frame.width, height), sheet, 14.0)]
    cover = fabric(rng) if rng.random() < 0.7 else linen(rng)
    half, way = frame.length / 2, rng.random()
    start = -half + float(rng.uniform(0.3, 0.6)) if way < 0.8 else float(rng.uniform(-0.3, 0.3)) * half
    if way < 0.92:
        hang = (float(rng.uniform(0.06, 0.35)), float(rng.uniform(0.02, 0.35)))
        meshes += duvet(rng, frame, start, half, hang, float(rng.uniform(0.015, 0.06)), cover)
        if way < 0.5:
            fold = linen(rng)
            meshes += duvet(
                rng, frame, start - 0.02, start + float(rng.uniform(0.15, 0.35)), (hang[0], 0.0), 0.075, fold
            )
    if way < 0.92 and rng.random() < 0.25:
        at = float(rng.uniform(0.1, 0.6)) * half
        end = min(at + float(rng.uniform(0.3, 0.6)), half - 0.05)
        meshes += duvet(rng, frame, at, end, (float(rng.uniform(0.2, 0.4)), 0.0), 0.085, fabric(rng))
    return meshes + _pillows(rng, frame, sheet)


def duvet(
    rng: np.random.Generator,
    frame: BedFrame,
    start: float,
    end: float,
    hang: tuple[float, float],
    thick: float,
    material: Material,
) -> list[Mesh]:
    """Bedding over the mattress from x start to end; hang: how far it falls at the sides and over the foot, metres."""
    side, foot = (min(drop, frame.high - 0.06) for drop in hang)
    half, round_ = frame.width / 2, 0.05
    a = np.concatenate(
        [
            np.linspace(start, end - round_, 4 + int(8.0 * (end - start))),
            end + np.linspace(-0.02, foot, 6)[: 6 if foot else 1],
        ]
    )
    b = half + np.concatenate([np.linspace(-0.04, 0.02, 3), np.linspace(0.04, max(side, 0.06), 4)])
    b = np.concatenate([-b[::-1], np.linspace(-half + 0.09, half - 0.09, 13), b])
    rows, columns = np.meshgrid(a, b, indexing="ij")
    over_x = np.maximum(rows - end, 0.0) if foot else np.zeros(rows.shape)
    over_y = np.maximum(np.abs(columns) - half, 0.0)
    bumps = noise(rng, 32, 32, slope=1.1)[: len(a), : len(b)] * thick * 0.16
    drop = np.maximum(over_x, over_y)
    away = thick * np.minimum(1.0, drop / 0.03)
    x = np.minimum(rows, end) + np.where(over_x > 0.0, away * (1.0 + 0.5 * bumps / thick), 0.0)
    y = np.sign(columns) * (np.minimum(np.abs(columns), half) + np.where(over_y > 0.0, away + bumps * 0.5, 0.0))
    z = frame.high + thick * (1.0 - np.minimum(1.0, drop / 0.03) * 0.6) + bumps - drop
    top = np.stack([x, y, np.maximum(z, 0.02)], axis=2)
    # Its edges are as thick as it is: the head end turns under.
    lip = top[:1].copy()
    lip[..., 2] -= thick * 1.1
    hem = surface(np.concatenate([lip, top[:1]]), material)
    parts = [hem, surface(top, material)]
    if not foot:
        last = top[-1:].copy()
        last[..., 2] -= thick * 1.1
        parts.append(surface(np.concatenate([top[-1:], last]), material))
    parts = [Part(material, part.positions[:, ::-1], -part.normals[:, ::-1], part.uv[:, ::-1]) for part in parts]
    return [Mesh(tuple(parts))]


def _pillows(rng: np.random.Generator, frame: BedFrame, sheet: Material) -> list[Mesh]:
    """One or two across, perhaps more in front; flat, or leaning against the head."""
    across = 2 if frame.width > 1.3 else 1
    cloth = sheet if rng.random() < 0.4 else linen(rng) if rng.random() < 0.6 else fabric(rng)
    wide = min(frame.width / across * 0.92, float(rng.uniform(0.5, 0.8)))
    deep, thick = float(rng.uniform(0.36, 0.5)), float(rng.uniform(0.1, 0.17))
    meshes, lean = [], float(rng.uniform(0.05, 0.3)) if rng.random() < 0.6 else float(rng.uniform(0.7, 1.1))
    places = [(0.0, cloth, 1.0)]
    if rng.random() < 0.3:
        places.append((0.2, fabric(rng), float(rng.uniform(0.6, 0.9))))
    for ahead, material, scale in places:
        for i in range(across):
            y = (i - (across - 1) / 2) * frame.width / across + float(rng.normal(0.0, 0.015))
            size = np.array([deep, wide, thick]) * scale
            angle = lean + float(rng.normal(0.0, 0.04)) + (0.2 if ahead else 0.0)
            c, s = np.cos(angle), np.sin(angle)
            half_x, half_z = (c * size[0] + s * size[2]) / 2, (s * size[0] + c * size[2]) / 2
            pillow = turned(cushion((0.0, 0.0, 0.0), size, material, 2.8), 1, angle, (0.0, 0.0, 0.0))
            x, z = -frame.length / 2 + 0.01 + half_x + ahead, frame.high + half_z * 0.9
            meshes.append(pillow.placed(x, y, z, 0.0))
    return meshes
