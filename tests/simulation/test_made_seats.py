"""Chairs and couches of our own."""

from __future__ import annotations

import numpy as np
import pytest

from edgemap.simulation.apartment.made import made
from edgemap.simulation.render.mesh import Mesh

# Least and most depth, width and height, metres.
SIZES = {
    "chair": ((0.35, 0.35, 0.7), (0.75, 0.75, 1.2)),
    "armchair": ((0.5, 0.5, 0.55), (1.2, 1.3, 1.2)),
    "office chair": ((0.5, 0.5, 0.7), (0.95, 0.95, 1.4)),
    "stool": ((0.28, 0.28, 0.4), (0.65, 0.65, 1.2)),
    "couch": ((0.6, 1.0, 0.55), (1.9, 3.2, 1.2)),
    "corner couch": ((1.1, 1.6, 0.6), (3.0, 3.6, 1.2)),
}
NUMBERS = range(1, 7)


def _facing(mesh: Mesh) -> np.ndarray:
    """Normals (T, 3) of the triangles themselves."""
    a, b, c = mesh.triangles().swapaxes(0, 1)
    normals = np.cross(b - a, c - a)
    return normals / np.linalg.norm(normals, axis=1, keepdims=True)


def _volume(mesh: Mesh) -> float:
    """Of a closed mesh: positive where its faces look outwards (divergence theorem)."""
    a, b, c = mesh.triangles().swapaxes(0, 1)
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0)


@pytest.mark.parametrize("kind", SIZES)
def test_a_seat_has_a_seats_size_and_stands_on_the_floor(kind):
    least, most = SIZES[kind]
    for number in NUMBERS:
        points = made(f"{kind}-{number}").triangles().reshape(-1, 3)
        low, high = points.min(axis=0), points.max(axis=0)
        assert np.all(high - low > least), (number, high - low)
        assert np.all(high - low < most), (number, high - low)
        assert np.allclose([*(low + high)[:2], low[2]], 0.0, atol=1e-9)
        assert len(points) < 3 * 5000


@pytest.mark.parametrize("kind", SIZES)
def test_its_normals_are_of_unit_length_and_on_the_side_that_its_faces_look_to(kind):
    for number in NUMBERS:
        mesh = made(f"{kind}-{number}")
        normals = np.concatenate([part.normals for part in mesh.parts])
        assert np.allclose(np.linalg.norm(normals, axis=2), 1.0, atol=1e-6)
        against = np.einsum("ij,ikj->ik", _facing(mesh), normals) < 0.0
        assert against.mean() < 0.01, number
        assert _volume(mesh) > 0.0


@pytest.mark.parametrize("kind", SIZES)
def test_a_number_is_one_model_and_another_number_another(kind):
    first, again, other = (made(f"{kind}-{number}").triangles() for number in (3, 3, 4))
    assert np.array_equal(first, again)
    assert first.shape != other.shape or not np.allclose(first, other)


def test_a_person_sits_looking_along_x():
    """A chair's upper part, its back, lies behind the middle of its seat."""
    for number in range(1, 13):
        points = made(f"chair-{number}").triangles().reshape(-1, 3)
        assert points[points[:, 2] > 0.9 * points[:, 2].max(), 0].max() < 0.05, number
