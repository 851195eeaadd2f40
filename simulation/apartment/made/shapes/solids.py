"""Blocks, boxes with round edges, cushions, upholstered blocks and balls."""

import numpy as np
from numpy.typing import ArrayLike

from edgemap.simulation.apartment.made.shapes.grids import grid, normals_of
from edgemap.simulation.apartment.made.shapes.lofts import lathe, loft
from edgemap.simulation.apartment.made.shapes.outlines import rectangle
from edgemap.simulation.render.mesh import Array, Material, Mesh, box

# Columns of a ring's plane for a body that goes along x, y or z, so that it goes round counter-clockwise.
_PLANES = ((1, 2, 0), (2, 0, 1), (0, 1, 2))


def block(x: float, y: float, z: float, depth: float, width: float, height: float, material: Material) -> Mesh:
    """A box of a size whose lower face has its middle at (x, y, z)."""
    low = np.array([x - depth / 2.0, y - width / 2.0, z])
    return box(low, low + [depth, width, height], material)


def rounded(low: ArrayLike, high: ArrayLike, material: Material, radius: float, edge: float, axis: int = 2) -> Mesh:
    """A box between two corners: edges along an axis are round by a radius, those of the two ends by `edge`."""
    low, high = np.asarray(low, dtype=np.float64), np.asarray(high, dtype=np.float64)
    size, middle = high - low, (low + high) / 2.0
    first, second, along = _PLANES[axis]
    edge = min(edge, size.min() / 2.0 - 1e-4)
    turn = np.linspace(0.0, np.pi / 2.0, 4)
    insets = edge * (1.0 - np.sin(turn))
    rises = edge * (1.0 - np.cos(turn))
    rings = []
    for inset, height in [
        *zip(insets, rises, strict=True),
        *zip(insets[::-1], (size[along] - rises)[::-1], strict=True),
    ]:
        flat = rectangle(size[first] - 2.0 * inset, size[second] - 2.0 * inset, radius - inset)
        ring = np.empty((len(flat), 3))
        ring[:, first], ring[:, second] = flat[:, 0] + middle[first], flat[:, 1] + middle[second]
        ring[:, along] = low[along] + height
        rings.append(ring)
    return loft(rings, material)


def cushion(middle: ArrayLike, size: ArrayLike, material: Material, squareness: float = 4.0) -> Mesh:
    """A padded body (superellipsoid) about a middle (3,) with outer sizes (3,); squareness 2 is an ellipsoid, 8 a
    box with soft edges."""
    exponent = 2.0 / squareness
    along, up = np.linspace(-np.pi, np.pi, 25), np.linspace(-np.pi / 2.0, np.pi / 2.0, 13)

    def rounded(values: Array) -> Array:
        return np.sign(values) * np.abs(values) ** exponent

    flat = rounded(np.cos(up))
    unit = np.stack(
        [
            flat[:, None] * rounded(np.cos(along))[None],
            flat[:, None] * rounded(np.sin(along))[None],
            np.broadcast_to(rounded(np.sin(up))[:, None], (len(up), len(along))),
        ],
        axis=2,
    )
    half = np.asarray(size, dtype=np.float64) / 2.0
    normals = np.sign(unit) * np.abs(unit) ** (squareness - 1.0) / half
    return Mesh((grid(np.asarray(middle) + unit * half, normals, material),))


def padded(middle: ArrayLike, size: ArrayLike, material: Material, radius: float = 0.05, swell: float = 0.1) -> Mesh:
    """An upholstered block about a middle (3,) with sides (3,): edges rounded by a radius, its faces swelling by this
    share of their distance from the middle."""
    half = np.asarray(size, dtype=np.float64) / 2.0
    radius = min(radius, 0.9 * float(half.min()))
    inner = half - radius
    ring, signs = [], ((1, 1), (-1, 1), (-1, -1), (1, -1))
    for corner, sign in enumerate(signs):
        for turn in np.pi / 2.0 * (corner + np.array([0.0, 0.5, 1.0])):
            ring.append((*(inner[:2] * sign), np.cos(turn), np.sin(turn)))
        ring.append((*(half[:2] * ((0, 1), (-1, 0), (0, -1), (1, 0))[corner]), 0.0, 0.0))
    ring = np.array([*ring, ring[0]])
    rows = [
        (0.0, 0.0, -1.0, -1),
        (0.55, 0.0, -1.0, -1),
        (1.0, 0.0, -1.0, -1),
        (1.0, 0.7, -0.7, -1),
        (1.0, 1.0, 0.0, -1),
    ]
    rows += [(1.0, 1.0, 0.0, 0)] + [(share, bend, -up, 1) for share, bend, up, _ in rows[::-1]]
    if not swell:
        ring = ring[np.arange(len(ring)) % 4 != 3]
        rows = [row for row in rows if row[0] != 0.55 and row[3]]
    middles = np.hypot(ring[:, 2], ring[:, 3]) < 0.5
    points = []
    for share, bend, up, level in rows:
        flat = ring[:, :2] - np.where(middles[:, None], np.sign(ring[:, :2]) * radius * (1.0 - bend), 0.0)
        flat = share * (flat + radius * bend * ring[:, 2:])
        points.append(np.column_stack([flat, np.full(len(ring), level * inner[2] + up * radius)]))
    points = np.array(points)
    share = points / half
    room = 1.0 - share**2
    others = np.stack([room[..., 1] * room[..., 2], room[..., 0] * room[..., 2], room[..., 0] * room[..., 1]], axis=2)
    points = points + swell * points * others
    normals = normals_of(points, round_=True)
    normals[0], normals[-1] = (0.0, 0.0, -1.0), (0.0, 0.0, 1.0)
    return Mesh((grid(np.asarray(middle) + points, normals, material),))


def ball(middle: ArrayLike, size: float, material: Material) -> Mesh:
    """A small round knob of a diameter about a middle (3,), cut coarsely."""
    up = np.linspace(-np.pi / 2.0, np.pi / 2.0, 7)
    x, y, z = (float(value) for value in np.asarray(middle))
    knob = lathe(np.cos(up) * size / 2.0, np.sin(up) * size / 2.0, material, 10)
    return Mesh((knob,)).placed(x, y, z, 0.0)
