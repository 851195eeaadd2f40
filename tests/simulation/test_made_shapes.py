"""What made furniture is put together from: sizes, closed bodies, sides that look outwards."""

from collections import Counter

import numpy as np
import pytest

from edgemap.simulation.apartment.made.shapes.lofts import (
    arc,
    filleted,
    lathe,
    loft,
    normals_of,
    oval,
    pad,
    plate,
    raised,
    rectangle,
    sheet,
)
from edgemap.simulation.apartment.made.shapes.solids import ball, bar, beam, block, cushion, padded, rod, rounded, tube
from edgemap.simulation.render.mesh import Material, Mesh

WOOD = Material()


def _volume(mesh: Mesh) -> float:
    """Of a closed mesh: positive where its faces look outwards (divergence theorem)."""
    a, b, c = mesh.triangles().swapaxes(0, 1)
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0)


def _open_edges(mesh: Mesh) -> int:
    """How many edges of triangles no other triangle runs along the other way."""
    corners = [[tuple(point) for point in triangle] for triangle in mesh.triangles().round(7) + 0.0]
    edges = Counter((corner[i - 1], corner[i]) for corner in corners for i in range(3) if corner[i - 1] != corner[i])
    return sum(max(count - edges[end, start], 0) for (start, end), count in edges.items())


def _box(mesh: Mesh) -> np.ndarray:
    points = mesh.triangles().reshape(-1, 3)
    return np.array([points.min(axis=0), points.max(axis=0)])


SLANTING = arc((0.0, 0.0, 0.0), (0.2, 0.3, 0.5), (0.1, -0.1, 0.0))
CLOSED = {
    "beam": beam((0.0, 0.0, 0.0), (0.1, 0.2, 0.7), (0.03, 0.05), WOOD, 0.6),
    "level beam": beam((0.0, 0.0, 0.0), (0.1, 0.2, 0.7), (0.03, 0.05), WOOD, across=(1.0, 0.0, 0.0), level=True),
    "tube": tube((0.1, 0.0, 0.0), (0.0, 0.3, 0.2), 0.03, WOOD, 0.01),
    "bar": bar((0.1, 0.0, 0.0), (0.0, 0.3, 0.2), 0.01, WOOD, 0.03),
    "rod": rod(SLANTING, np.linspace(0.02, 0.01, len(SLANTING)), WOOD),
    "strap": rod(SLANTING, 0.02, WOOD, 0.3, across=(1.0, 0.0, 0.2)),
    "ring": rod(filleted([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)], 0.2, closed=True), 0.02, WOOD, closed=True),
    "plate": plate(rectangle(0.4, 0.6) + [0.1, 0.3], 0.2, 0.25, WOOD, 0.8),
    "round plate": plate(oval(0.4, 0.6, 3.0, points=40), 0.2, 0.25, WOOD, 0.8),
    "pad": pad(oval(0.5, 0.5, 5.0, width_behind=0.4), 0.4, 0.46, WOOD, 0.02),
    "loft": loft([raised(rectangle(0.3, 0.2, 0.05), 0.0, 0.0, z, 1.0 + z) for z in (0.0, 0.1, 0.3)], WOOD),
    "sheet": sheet(np.stack([SLANTING, SLANTING + [0.0, 0.3, 0.0]]), 0.02, WOOD),
    "block": block(0.1, 0.2, 0.3, 0.4, 0.5, 0.6, WOOD),
    "rounded": rounded((0.0, 0.1, 0.2), (0.3, 0.5, 0.8), WOOD, 0.05, 0.02, axis=1),
    "cushion": cushion((0.0, 0.1, 0.2), (0.3, 0.5, 0.2), WOOD, 3.0),
    "padded": padded((0.0, 0.1, 0.2), (0.3, 0.5, 0.2), WOOD, 0.05, 0.1),
    "ball": ball((0.0, 0.1, 0.2), 0.1, WOOD),
    "lathe": Mesh((lathe(np.array([0.0, 0.2, 0.1, 0.0]), np.array([0.0, 0.0, 0.3, 0.3]), WOOD),)),
}


@pytest.mark.parametrize("name", CLOSED)
def test_it_is_closed_and_its_sides_and_normals_look_outwards(name: str) -> None:
    mesh = CLOSED[name]
    assert _open_edges(mesh) == 0
    assert _volume(mesh) > 0.0
    normals = np.concatenate([part.normals for part in mesh.parts])
    np.testing.assert_allclose(np.linalg.norm(normals, axis=2), 1.0, atol=1e-6)
    a, b, c = mesh.triangles().swapaxes(0, 1)
    facing = np.cross(b - a, c - a)
    facing /= np.linalg.norm(facing, axis=1, keepdims=True)
    assert np.einsum("tcd,td->tc", normals, facing).mean(axis=1).min() > 0.0


def test_what_has_a_size_is_as_large_as_asked():
    np.testing.assert_allclose(_box(CLOSED["block"]), [[-0.1, -0.05, 0.3], [0.3, 0.45, 0.9]])
    np.testing.assert_allclose(_box(CLOSED["rounded"]), [[0.0, 0.1, 0.2], [0.3, 0.5, 0.8]])
    np.testing.assert_allclose(_box(CLOSED["cushion"]), [[-0.15, -0.15, 0.1], [0.15, 0.35, 0.3]])
    np.testing.assert_allclose(_box(CLOSED["plate"]), [[-0.1, 0.0, 0.2], [0.3, 0.6, 0.25]])
    np.testing.assert_allclose(_box(CLOSED["ball"])[:, 2], [0.15, 0.25])


def test_a_beam_cut_level_stands_flat_and_keeps_its_size_across():
    mesh = CLOSED["level beam"]
    assert (np.unique(mesh.triangles()[..., 2].round(9)) == [0.0, 0.7]).all()
    assert _volume(mesh) == pytest.approx(np.linalg.norm([0.1, 0.2, 0.7]) * 0.03 * 0.05)


def test_a_rod_may_stay_open():
    shut, open_ = (rod(SLANTING, 0.02, WOOD, sides=6, ends=ends) for ends in (True, False))
    assert len(shut.triangles()) - len(open_.triangles()) == 2 * 6
    assert _open_edges(shut) == 0
    assert _open_edges(open_) == 2 * 6


def test_a_strap_is_wide_where_it_is_told_to_be():
    low, high = _box(rod([(0, 0, 0), (0, 0, 1)], 0.05, WOOD, 0.1, across=(0.0, 1.0, 0.0)))
    np.testing.assert_allclose(high - low, [0.01, 0.1, 1.0], atol=1e-12)


def test_outlines_are_closed_counter_clockwise_and_enclose_what_they_should():
    def area(outline: np.ndarray) -> float:
        np.testing.assert_array_equal(outline[0], outline[-1])
        (x0, y0), (x1, y1) = outline[:-1].T, outline[1:].T
        return float((x0 * y1 - x1 * y0).sum() / 2.0)

    assert area(rectangle(0.4, 0.6)) == pytest.approx(0.24)
    corners = (4.0 - np.pi) * 0.1**2
    assert area(rectangle(0.4, 0.6, 0.1, steps=40)) == pytest.approx(0.24 - corners, rel=1e-4)
    assert area(oval(0.4, 0.6, points=400)) == pytest.approx(np.pi * 0.2 * 0.3, rel=1e-3)
    assert area(oval(0.4, 0.6, behind=20.0, points=4000)) > area(oval(0.4, 0.6, points=4000)) + 0.02
    low = oval(0.4, 0.6, 20.0, width_behind=0.3, points=400)
    assert np.ptp(low[low[:, 0] < -0.19, 1]) == pytest.approx(0.3, rel=0.1)


def test_normals_of_a_cylinder_look_away_from_its_axis_at_the_seam_too():
    turn = np.linspace(0.0, 2.0 * np.pi, 13)
    around = np.column_stack([np.cos(turn), np.sin(turn), 0.0 * turn])
    np.testing.assert_allclose(normals_of(np.stack([around, around + [0, 0, 1]]), True), [around, around], atol=1e-9)


def test_bodies_hold_what_their_measures_say():
    plain, bulged = (padded((1.0, 2.0, 3.0), (0.8, 0.6, 0.2), WOOD, 0.03, bulge) for bulge in (0.0, 0.1))
    np.testing.assert_allclose(_box(plain), [[0.6, 1.7, 2.9], [1.4, 2.3, 3.1]])
    assert 0.94 * 0.096 < _volume(plain) < 0.096
    assert _volume(bulged) > _volume(plain)
    assert _volume(beam((0, 0, 0), (0.3, 0, 0.4), (0.02, 0.04), WOOD)) == pytest.approx(0.5 * 0.02 * 0.04)
    square = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1], [1, 1]]) / 2.0
    assert _volume(plate(square, 0.4, 0.43, WOOD)) == pytest.approx(0.03)
    y, z = np.meshgrid(np.linspace(0.0, 0.5, 4), np.linspace(0.0, 0.3, 3))
    assert _volume(sheet(np.stack([0.0 * y, y, z], axis=2), 0.02, WOOD)) == pytest.approx(0.5 * 0.3 * 0.02)
    turn = np.linspace(0.0, 2.0 * np.pi, 65)
    ring = rod(np.stack([np.cos(turn), np.sin(turn), 0.0 * turn], axis=1), 0.02, WOOD, sides=32, closed=True)
    assert _volume(ring) == pytest.approx(2.0 * np.pi**2 * 0.02**2, rel=0.02)
