"""Solid shapes: bars, boxes with round edges, cushions and upholstered blocks."""

import numpy as np
from numpy.typing import ArrayLike

from edgemap.simulation.apartment.made.shapes.lofts import grid, loft, normals_of, rectangle, surface
from edgemap.simulation.render.mesh import Array, Material, Mesh, Part, quad

# The two axes of a ring and the axis of the body, for bodies along x, y and z. The ring runs counter-clockwise.
_PLANES = ((1, 2, 0), (2, 0, 1), (0, 1, 2))


def rounded(low: ArrayLike, high: ArrayLike, material: Material, radius: float, edge: float, axis: int = 2) -> Mesh:
    """A box between two corners (3,). radius: of the edges along `axis`. edge: radius of the edges of both ends."""
    low, high = np.asarray(low, dtype=np.float64), np.asarray(high, dtype=np.float64)
    size, middle = high - low, (low + high) / 2.0
    first, second, along = _PLANES[axis]
    edge = min(edge, size.min() / 2.0 - 1e-4)
    turn = np.linspace(0.0, np.pi / 2.0, 4)
    insets, rises = edge * (1.0 - np.sin(turn)), edge * (1.0 - np.cos(turn))
    heights = [*rises, *(size[along] - rises)[::-1]]
    rings = []
    for inset, height in zip([*insets, *insets[::-1]], heights, strict=True):
        flat = rectangle(size[first] - 2.0 * inset, size[second] - 2.0 * inset, radius - inset)
        ring = np.empty((len(flat), 3))
        ring[:, first], ring[:, second] = flat[:, 0] + middle[first], flat[:, 1] + middle[second]
        ring[:, along] = low[along] + height
        rings.append(ring)
    return loft(rings, material)


def cushion(middle: ArrayLike, size: ArrayLike, material: Material, squareness: float = 4.0) -> Mesh:
    """A padded body (superellipsoid) with a centre (3,) and outer sizes (3,). squareness: 2 gives an ellipsoid, 8 a box
    with soft edges."""
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
    return [grid(np.asarray(middle) + unit * half, normals, material)]


def padded(middle: ArrayLike, size: ArrayLike, material: Material, radius: float = 0.05, swell: float = 0.1) -> Mesh:
    """An upholstered block with a centre (3,) and side lengths (3,). radius: of the edges. swell: the faces bulge by
    this share of their distance from the centre."""
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
    return [grid(np.asarray(middle) + points, normals, material)]


def beam(
    start: ArrayLike,
    end: ArrayLike,
    size: tuple[float, float],
    material: Material,
    taper: float = 1.0,
    across: ArrayLike = (0.0, 1.0, 0.0),
    level: bool = False,
) -> Mesh:
    """A square-edged bar between two points (3,).

    size: width along `across`, and width perpendicular to `across` and to the bar. taper: size of the section at the
    end relative to the start. level: the ends of a slanted bar are cut horizontally.
    """
    start, end = np.asarray(start, dtype=np.float64), np.asarray(end, dtype=np.float64)
    axis = _unit(end - start)
    side = _unit(np.asarray(across) - (np.asarray(across) @ axis) * axis)
    ring = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) / 2.0 * size @ np.stack([side, np.cross(axis, side)])
    if level:
        ring = ring - axis * (ring[:, 2:] / axis[2])
    low, high = start + ring, end + taper * ring
    length = float(np.linalg.norm(end - start))
    sides = [np.stack([low[i], low[i - 3], high[i - 3], high[i]]) for i in range(4)]
    parts = [_facet(corners, (length, size[i % 2]), material) for i, corners in enumerate(sides)]
    return [*parts, _facet(high, size, material), _facet(low[::-1], size, material)]


def _facet(corners: Array, size: tuple[float, float], material: Material) -> Part:
    """A flat face with four corners (4, 3), counter-clockwise. The grain of wood runs along its second edge."""
    u, v = size
    face = quad(corners[0], corners[1] - corners[0], corners[3] - corners[0], material)
    order = np.array([[0, 1, 2], [0, 2, 3]])
    coordinates = np.array([[0.0, 0.0], [0.0, v], [u, v], [u, 0.0]])
    return Part(material, corners[order], face.normals, coordinates[order])


def rod(
    path: ArrayLike,
    radius: ArrayLike,
    material: Material,
    flat: float = 1.0,
    sides: int = 8,
    across: ArrayLike | None = None,
    closed: bool = False,
    ends: bool = True,
) -> Mesh:
    """A round bar along a path (N, 3). radius: one value, or one for each point.

    flat: ratio of the height of the section to its width, for ovals and straps. across: (3,), direction of the width,
    as far as the path allows; by default the section rotates as little as possible. closed: the path ends where it
    starts. ends: whether both ends are closed.
    """
    path = np.asarray(path, dtype=np.float64)
    ahead = np.concatenate([path[-2:-1], path, path[1:2]]) if closed else path
    along = _unit(np.gradient(ahead, axis=0)[1:-1] if closed else np.gradient(ahead, axis=0))
    side = np.eye(3)[int(np.argmin(np.ptp(path, axis=0) + 0.1 * np.abs(along[0])))]
    wide = []
    for direction in along:
        side = side if across is None else np.asarray(across, dtype=np.float64)
        side = _unit(side - (side @ direction) * direction)
        wide.append(side)
    wide = np.array(wide)[:, None]
    turn = np.linspace(0.0, 2.0 * np.pi, sides + 1)[:, None]
    radii = np.broadcast_to(np.asarray(radius, dtype=np.float64), len(path))[:, None, None]
    rings = path[:, None] + radii * (np.cos(turn) * wide + flat * np.sin(turn) * np.cross(along[:, None], wide))
    if closed:
        return [surface(rings, material, round_=True, looped=True)]
    return loft(rings, material, low=ends, high=ends)


def _unit(vectors: Array) -> Array:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-12)
