"""Textures of our own pieces: (H, W, 4) uint8 sRGB with alpha 255, which shade a colour."""

import numpy as np
from numpy.typing import ArrayLike

from edgemap.simulation.apartment.textures import Texture, finished, noise

_PX = 128


def mottled(
    rng: np.random.Generator,
    contrast: float,
    slope: float,
    stretch: float = 1.0,
    white: float = 225.0,
    stripes: int = 0,
    checked: bool = False,
    dark: float = 1.0,
) -> Texture:
    """Cloth, or with a stretch of 10 and more wood and steel, their grain along the columns; with stripes or checks
    where `stripes` is more than 0, darkened by a factor."""
    field = 1.0 + contrast * noise(rng, _PX, _PX, stretch=stretch, slope=slope)
    if stripes:
        bands = np.arange(_PX) * stripes // _PX % 2
        both = np.maximum(bands[:, None], bands[None]) if checked else np.broadcast_to(bands, field.shape)
        field = field * np.where(both, dark, 1.0)
    return finished(field[..., None] * white)


def cane(rng: np.random.Generator) -> Texture:
    """Cane, rush or rattan."""
    strand = 0.45 + 0.55 * np.broadcast_to(np.abs(np.sin(np.linspace(0.0, np.pi, 8)))[:, None], (8, 8))
    cell = np.block([[strand, strand.T], [strand.T, strand]])
    field = np.tile(cell, (_PX // 16, _PX // 16)) * rng.uniform(0.9, 1.0, (_PX, _PX))
    return finished(field[..., None] * 255.0)


def wicker(rng: np.random.Generator) -> Texture:
    """A basket's weave."""
    row, column = np.mgrid[0:64, 0:64]
    field = 150.0 + 75.0 * ((row // 2 + column // 2) % 2) + 6.0 * noise(rng, 64, 64)
    return finished(field[..., None])


def leaf(pattern: str = "", at: float = 0.0, dark: ArrayLike = 1.0) -> Texture:
    """A leaf with a midrib. pattern: edge, middle (wide by `at`), bands (`at` radians along it) or patches keep the
    colour, the rest is darkened by factors (3,)."""
    v, u = np.mgrid[0:32, 0:32] / 32.0
    shade = 0.86 + 0.14 * np.clip(np.abs(u - 0.5) * 16.0 - 0.3, 0.0, 1.0)
    texels = finished((shade * 225.0)[..., None])
    if pattern:
        keep = {
            "edge": np.abs(u - 0.5) > at,
            "middle": np.abs(u - 0.5) <= at,
            "bands": np.sin(v * at + 2.0 * np.sin(9.0 * u)) > 0.2,
            "patches": np.sin(14.0 * u + 5.0 * np.sin(7.0 * v)) * np.sin(17.0 * v + 3.0) > 0.2,
        }[pattern]
        texels[..., :3] = np.where(keep[..., None], texels[..., :3], texels[..., :3] * np.asarray(dark))
    return texels


DRAWN = {"mottled": mottled, "cane": cane, "wicker": wicker, "leaf": leaf}
