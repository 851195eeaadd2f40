"""Procedural textures that tile without seams: (H, W, 4) uint8 sRGB with alpha 255, deterministic per generator."""

from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from edgemap.simulation.render.mesh import Array

Texture = NDArray[np.uint8]


def noise(rng: np.random.Generator, rows: int, columns: int, stretch: float = 1.0, slope: float = 1.5) -> Array:
    """Periodic noise (rows, columns) with zero mean and unit variance. Its power falls with frequency^(-2 slope).

    stretch: a value above 1 elongates the noise along the columns.
    """
    # Cycles per pixel of the longer side, so that noise of a flat strip looks the same along both.
    longest = max(rows, columns)
    fy, fx = np.fft.fftfreq(rows)[:, None] * longest, np.fft.rfftfreq(columns)[None] * longest
    frequency = np.hypot(fy, fx * stretch)
    frequency[0, 0] = np.inf
    spectrum = np.fft.rfft2(rng.standard_normal((rows, columns))) / frequency**slope
    field = np.fft.irfft2(spectrum, s=(rows, columns))
    return field / field.std()


def grained(rng: np.random.Generator, size_px: int, *layers: tuple[float, float]) -> Array:
    """Factors on a colour, (size, size, 1): 1 with noise in layers, each of an amount and a slope."""
    field = np.ones((size_px, size_px))
    for amount, slope in layers:
        field = field + amount * noise(rng, size_px, size_px, slope=slope)
    return field[..., None]


def planks(rng: np.random.Generator, colour: ArrayLike, size_px: int = 1024, count: int = 14) -> Texture:
    """A wooden floor of `count` planks that run along u. Each has its own shade, grain and end joints."""
    image = np.empty((size_px, size_px, 3))
    edges = np.linspace(0, size_px, count + 1).astype(int)
    base = np.asarray(colour, dtype=np.float64)
    for top, bottom in pairwise(edges):
        joints = (rng.integers(size_px) + np.array([0, size_px * 0.46])).astype(int) % size_px
        board = np.empty((bottom - top, size_px, 3))
        for start, end in (joints, joints[::-1]):
            columns = np.arange(start, end if end > start else end + size_px) % size_px
            shade = base * rng.uniform(0.86, 1.10) * (1.0 + rng.normal(0.0, 0.012, 3))
            grain = noise(rng, bottom - top, size_px, stretch=14.0, slope=0.8)
            fine = noise(rng, bottom - top, size_px, stretch=30.0, slope=0.5)
            board[:, columns] = (shade * (1.0 + 0.07 * grain + 0.05 * fine)[..., None])[:, columns]
            board[:, start % size_px : start % size_px + 2] = base * 0.42
        board[:2] = base * 0.45
        board[2:4] *= 0.85
        image[top:bottom] = board
    return finished(image)


def paint(rng: np.random.Generator, colour: ArrayLike) -> Texture:
    """Painted plaster: almost uniform, with the orange-peel texture of a paint roller."""
    return finished(np.asarray(colour) * grained(rng, 256, (0.012, 0.6), (0.004, 1.6)))


def tiles(rng: np.random.Generator, colour: ArrayLike, count: int = 4) -> Texture:
    """Stone tiles with pale or dark joints, `count` along each side. Each has its own shade; some are chequered."""
    size_px = 512
    row, column = np.divmod(np.arange(size_px) * count, size_px)
    shade = rng.uniform(0.95, 1.05, (count, count))
    if rng.random() < 0.35:
        shade = shade * np.where(np.add.outer(np.arange(count), np.arange(count)) % 2, rng.uniform(0.3, 0.8), 1.0)
    veins = noise(rng, size_px, size_px, slope=1.3)
    image = np.asarray(colour, dtype=np.float64) * (shade[np.ix_(row, row)] * (1.0 + 0.035 * veins))[..., None]
    joint = np.minimum(column, size_px - 1 - column) < max(2, count) * 1.5
    image[joint[:, None] | joint[None]] = np.asarray(colour, dtype=np.float64) * rng.choice([0.6, 0.85])
    return finished(image)


def parquet(rng: np.random.Generator, colour: ArrayLike) -> Texture:
    """Parquet of squares. The short strips of a square run along u or along v, in alternation."""
    count, size_px = 6, 768
    side = size_px // count
    image = np.empty((side * count, side * count, 3))
    base = np.asarray(colour, dtype=np.float64)
    strips = 5
    edge = np.arange(side) * strips % side < strips
    for i, j in np.ndindex(count, count):
        shade = base * rng.uniform(0.85, 1.12, strips)[np.arange(side) * strips // side, None]
        field = 1.0 + 0.06 * noise(rng, side, side, stretch=10.0, slope=0.6)
        square = shade[:, None] * field[..., None]
        square[edge] *= 0.7
        square[:, 0] *= 0.7
        image[i * side : (i + 1) * side, j * side : (j + 1) * side] = square if (i + j) % 2 else square.swapaxes(0, 1)
    return finished(image)


def carpet(rng: np.random.Generator, colour: ArrayLike) -> Texture:
    """Short-pile carpet: fine speckle, and faint clouds where people have walked."""
    return finished(np.asarray(colour) * grained(rng, 384, (0.10, 0.15), (0.03, 1.5)))


def wallpaper(rng: np.random.Generator, colour: ArrayLike) -> Texture:
    """Stripes, or a lattice of soft dots, in a second tone of the same paper."""
    size_px = 256
    base = np.asarray(colour, dtype=np.float64)
    other = np.clip(base * rng.uniform(0.75, 1.15, 3), 0.0, 250.0)
    v, u = np.meshgrid(np.arange(size_px) / size_px, np.arange(size_px) / size_px, indexing="ij")
    count = int(rng.integers(3, 9))
    if rng.random() < 0.5:
        mix = ((u * count) % 1.0 < rng.uniform(0.2, 0.6)).astype(np.float64)
    else:
        row = np.floor(v * 2 * count)
        across, up = (u * count + 0.5 * (row % 2)) % 1.0 - 0.5, (v * 2 * count) % 1.0 - 0.5
        mix = np.clip(8.0 * (rng.uniform(0.2, 0.38) - np.hypot(across, up * 0.7)), 0.0, 1.0)
    return finished((base + (other - base) * mix[..., None]) * grained(rng, size_px, (0.012, 0.5)))


def rug(rng: np.random.Generator, colours: ArrayLike, size_px: int = 768) -> Texture:
    """A rug: border bands and a lattice of diamonds woven from three or more colours (N, 3)."""
    palette = np.asarray(colours, dtype=np.float64)
    v, u = np.meshgrid(np.linspace(-1, 1, size_px), np.linspace(-1, 1, size_px), indexing="ij")
    lattice = np.abs(((u + v) * 4.0) % 2.0 - 1.0) + np.abs(((u - v) * 4.0) % 2.0 - 1.0)
    index = np.digitize(lattice, [0.45, 0.75, 1.25, 1.55]) % len(palette)
    edge = np.maximum(np.abs(u), np.abs(v))
    index = np.where(edge > 0.80, 1, index)
    index = np.where((edge > 0.84) & (edge < 0.93), 2 % len(palette), index)
    index = np.where(edge > 0.97, 0, index)
    return finished(palette[index] * grained(rng, size_px, (0.09, 0.1), (0.05, 1.4)))


def woven(rng: np.random.Generator, colours: ArrayLike) -> Texture:
    """A plain rug: broad bands, fine stripes, or rings, in two or more colours (N, 3)."""
    size_px = 512
    palette = np.asarray(colours, dtype=np.float64)
    v, u = np.meshgrid(np.linspace(-1, 1, size_px), np.linspace(-1, 1, size_px), indexing="ij")
    way = int(rng.integers(3))
    field = (u if way == 0 else np.maximum(np.abs(u), np.abs(v)) if way == 1 else np.hypot(u, v)) + 2.0
    index = np.floor(field * rng.uniform(1.5, 9.0)).astype(int) % len(palette)
    return finished(palette[index] * grained(rng, size_px, (0.10, 0.1), (0.04, 1.4)))


def abstract(rng: np.random.Generator) -> Texture:
    """A modern picture: flat fields of colour cut by soft edges."""
    palette = rng.uniform(20, 245, (int(rng.integers(3, 7)), 3))
    field = noise(rng, 256, 256, slope=rng.uniform(1.2, 2.0))
    index = np.digitize(field, np.linspace(-1.3, 1.3, len(palette) - 1))
    return finished(palette[index] * grained(rng, 256, (0.05, 0.6)))


def landscape(rng: np.random.Generator) -> Texture:
    """A painting for the wall: sky, layered hills and a sun, in broad strokes."""
    width_px, height_px = 384, 256
    v = np.linspace(1.0, 0.0, height_px)[:, None]
    sky = np.array([[[120, 165, 205]]]) * v[..., None] + np.array([[[240, 200, 150]]]) * (1.0 - v[..., None])
    image = np.broadcast_to(sky, (height_px, width_px, 3)).copy()
    sun_u, sun_v = rng.uniform(0.2, 0.8), rng.uniform(0.25, 0.4)
    u = np.linspace(0.0, 1.0, width_px)[None]
    image[np.hypot((u - sun_u) * width_px / height_px, 1.0 - v - sun_v) < 0.07] = (250, 236, 196)
    for layer in range(5):
        ridge = 0.45 + 0.12 * layer + 0.05 * noise(rng, 1, width_px, slope=1.4)[0]
        tone = np.array([92, 118, 128]) * (1.0 - 0.13 * layer) + rng.uniform(-12, 12, 3)
        image = np.where(((1.0 - v) > ridge[None])[..., None], tone, image)
    return finished(image * (1.0 + 0.06 * noise(rng, height_px, width_px, slope=0.8)[..., None]))


def outdoors(rng: np.random.Generator) -> Texture:
    """The view through a window at the exposure of the room: bright sky above pale, blurred greenery."""
    width_px, height_px = 256, 256
    v = np.linspace(1.0, 0.0, height_px)[:, None]
    leaves = noise(rng, height_px, width_px, slope=1.3)
    line = 0.38 + 0.07 * noise(rng, 1, width_px, slope=1.3)
    green = np.array([150, 172, 128]) + 26.0 * leaves[..., None]
    sky = np.array([232.0, 240.0, 250.0]) - 10.0 * noise(rng, height_px, width_px, slope=2.0)[..., None] ** 2
    mix = np.clip((line - v) * 14.0, 0.0, 1.0)[..., None]
    return finished(green * mix + sky * (1.0 - mix))


def finished(image: Array) -> Texture:
    """The texture of an image (H, W, 3), or a grey one (H, W, 1), 0..255."""
    rgba = np.full((*image.shape[:2], 4), 255, dtype=np.uint8)
    rgba[..., :3] = np.clip(image, 0.0, 255.0).astype(np.uint8)
    return rgba
