"""Made tables, beds and plants: sizes, shading that agrees with the triangles, one number one model."""

import numpy as np
import pytest

from edgemap.simulation.apartment.made import FLAT_TOPS, MAKERS, made

NUMBERS = range(1, 13)
# Least and most of depth, width and height, metres.
SIZES = {
    "dining table": ((0.6, 0.7, 0.68), (1.4, 2.5, 0.8)),
    "bed": ((1.1, 0.6, 0.4), (2.7, 2.4, 2.2)),
    "potted plant": ((0.1, 0.1, 0.35), (2.2, 2.2, 2.0)),
    "small plant": ((0.05, 0.05, 0.1), (0.7, 0.7, 0.5)),
}


@pytest.fixture(scope="module")
def meshes():
    return {kind: [made(f"{kind}-{number}") for number in NUMBERS] for kind in SIZES}


@pytest.mark.parametrize("kind", SIZES)
def test_it_is_as_large_as_real_ones_and_stands_on_the_floor_at_its_middle(meshes, kind):
    least, most = SIZES[kind]
    for number, mesh in zip(NUMBERS, meshes[kind], strict=True):
        points = mesh.triangles().reshape(-1, 3)
        low, high = points.min(axis=0), points.max(axis=0)
        assert np.all(high - low >= least), (kind, number, high - low)
        assert np.all(high - low <= most), (kind, number, high - low)
        np.testing.assert_allclose([*(low + high)[:2], low[2]], 0.0, atol=1e-9)
        assert len(mesh.triangles()) <= 6600, (kind, number)


@pytest.mark.parametrize("kind", SIZES)
def test_normals_are_of_unit_length_and_face_as_the_triangles_do(meshes, kind):
    for number, mesh in zip(NUMBERS, meshes[kind], strict=True):
        for part in mesh.parts:
            assert np.isfinite(part.positions).all()
            np.testing.assert_allclose(np.linalg.norm(part.normals, axis=2), 1.0, atol=1e-6)
        corners = mesh.triangles()
        wound = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        shading = np.concatenate([part.normals for part in mesh.parts]).mean(axis=1)
        area = np.linalg.norm(wound, axis=1)
        # Where a surface is creased, a sliver may disagree; hardly any area may.
        against = area[(wound * shading).sum(axis=1) <= 0.0].sum()
        assert against < 0.005 * area.sum(), (kind, number, against / area.sum())


@pytest.mark.parametrize("kind", SIZES)
def test_a_number_is_one_model_and_another_number_another(meshes, kind):
    np.testing.assert_array_equal(made(f"{kind}-3").triangles(), meshes[kind][2].triangles())
    shapes = {mesh.triangles().tobytes() for mesh in meshes[kind]}
    assert len(shapes) == len(NUMBERS)


def test_nothing_sticks_out_above_a_table(meshes):
    """Its highest level is the top: a surface as large as things need that stand on it."""
    assert "dining table" in FLAT_TOPS
    for number, mesh in zip(NUMBERS, meshes["dining table"], strict=True):
        corners = mesh.triangles()
        highest = corners[..., 2].max()
        level = corners[(corners[..., 2] > highest - 1e-6).all(axis=1)]
        area = np.linalg.norm(np.cross(level[:, 1] - level[:, 0], level[:, 2] - level[:, 0]), axis=1).sum() / 2.0
        box = np.ptp(corners.reshape(-1, 3)[:, :2], axis=0).prod()
        assert area > 0.6 * box, number


def test_a_beds_head_is_at_its_back(meshes):
    """Pillows and headboards make the back half of nearly every bed the higher one."""
    higher = 0
    for mesh in meshes["bed"]:
        points = mesh.triangles().reshape(-1, 3)
        back, front = (points[points[:, 0] * side > 0.0, 2].max() for side in (-1.0, 1.0))
        higher += back >= front - 1e-9
    assert higher >= len(NUMBERS) - 1


def test_every_kind_here_can_be_made():
    assert set(SIZES) <= set(MAKERS)
