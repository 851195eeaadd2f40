"""Made kitchen and bathroom pieces and bags: sizes as of real ones, drawn anew by number, faces outwards."""

from __future__ import annotations

import hashlib
from functools import cache

import numpy as np
import pytest

from edgemap.simulation.apartment.made import made
from edgemap.simulation.render.mesh import Mesh

# Depth, width and height in metres: the least and the most.
SIZES = {
    "refrigerator": ((0.5, 0.8), (0.44, 0.96), (0.8, 2.06)),
    "oven": ((0.54, 0.75), (0.48, 1.12), (0.84, 1.52)),
    "microwave": ((0.3, 0.5), (0.4, 0.6), (0.24, 0.36)),
    "toilet": ((0.5, 0.8), (0.33, 1.02), (0.38, 1.25)),
    "basin": ((0.25, 0.68), (0.36, 0.9), (0.8, 1.15)),
    "backpack": ((0.15, 0.5), (0.26, 0.56), (0.38, 1.0)),
    "suitcase": ((0.07, 0.55), (0.3, 0.95), (0.25, 1.2)),
}
NUMBERS = (1, 2, 3, 5, 21, 40)


@cache
def _made(kind: str, number: int) -> Mesh:
    return made(f"{kind}-{number}")


@pytest.mark.parametrize("kind", SIZES)
def test_sizes_are_plausible_and_the_origin_is_on_the_floor(kind: str) -> None:
    for number in NUMBERS:
        points = _made(kind, number).triangles().reshape(-1, 3)
        low, high = points.min(axis=0), points.max(axis=0)
        for size, (least, most) in zip(high - low, SIZES[kind], strict=True):
            assert least <= size <= most, (number, high - low)
        np.testing.assert_allclose((low + high)[:2], 0.0, atol=1e-9)
        assert abs(low[2]) < 1e-9


@pytest.mark.parametrize("kind", SIZES)
def test_a_number_draws_one_model_and_another_a_different_one(kind: str) -> None:
    drawn = [_made(kind, number).triangles() for number in NUMBERS]
    np.testing.assert_array_equal(drawn[2], made(f"{kind}-{NUMBERS[2]}").triangles())
    assert len({triangles.sum().round(9) for triangles in drawn}) == len(NUMBERS)
    assert max(map(len, drawn)) < 5000


@pytest.mark.parametrize("kind", SIZES)
def test_normals_are_unit_and_on_the_side_that_triangles_face(kind: str) -> None:
    for number in NUMBERS:
        for part in _made(kind, number).parts:
            np.testing.assert_allclose(np.linalg.norm(part.normals, axis=2), 1.0, atol=1e-6)
            a, b, c = part.positions.swapaxes(0, 1)
            facing = np.cross(b - a, c - a)
            facing /= np.linalg.norm(facing, axis=1, keepdims=True)
            agree = np.einsum("tcd,td->tc", part.normals, facing)
            assert (agree.mean(axis=1) > 0.0).all(), (number, part.material.colour, agree.mean(axis=1).min())


def test_closed_bodies_enclose_their_inside() -> None:
    # By the divergence theorem; inside-out bodies would take volume away.
    for kind, least in (("refrigerator", 0.75), ("microwave", 0.75), ("oven", 0.75)):
        for number in NUMBERS:
            triangles = _made(kind, number).triangles()
            volume = np.einsum("td,td->", triangles[:, 0], np.cross(triangles[:, 1], triangles[:, 2])) / 6.0
            assert volume > least * np.ptp(triangles.reshape(-1, 3), axis=0).prod() * 0.6, (kind, number)


def test_the_first_suitcases_are_those_that_homes_have_always_shown() -> None:
    digest = hashlib.sha256()
    for number in range(1, 11):
        digest.update(np.round(made(f"suitcase-{number}").triangles() * 1e5).astype(np.int64).tobytes())
    assert digest.hexdigest()[:16] == "50d5a127ec5fd092"
