"""Our own furniture: the pieces that homes have always shown, faces outwards; their meshes."""

import hashlib
import io
import zipfile
from functools import cache

import numpy as np
import pytest

from edgemap.simulation.apartment.furniture import kinds
from edgemap.simulation.apartment.made import LIBRARY, made
from edgemap.simulation.render.mesh import Material, quad, subdivided, triangles_of
from edgemap.simulation.render.obj import read_obj

KINDS = sorted(name for name, kind in kinds().items() if kind.frozen)
# Of pieces 1, 5 and 101 of each kind, recorded at commit 70b7955, which drew them.
SUM = "d60397eec7dbea6a"
NUMBERS = (1, 2, 3, 5, 12, 16, 101)


@cache
def piece(kind, number):
    return made(f"{kind}-{number}")


def test_every_piece_that_a_home_may_show_is_there():
    shown = {key for kind in kinds().values() for key in (*kind.training, *kind.made, *kind.held_out, *kind.frozen)}
    for key in sorted(key for key in shown if key.startswith(LIBRARY))[::40]:
        assert len(triangles_of(made(key.partition("/")[2]))) > 10, key


def test_pieces_and_their_materials_never_change():
    digest = hashlib.sha256()
    for kind in KINDS:
        for number in (1, 5, 101):
            mesh = piece(kind, number)
            digest.update(np.round(triangles_of(mesh) * 1e5).astype(np.int64).tobytes())
            for part in mesh:
                texture = part.material.texture
                digest.update(repr((np.round(part.material.colour, 6).tolist(), part.material.gloss)).encode())
                digest.update(b"" if texture is None else np.round(texture / 16.0).astype(np.uint8).tobytes())
    assert digest.hexdigest()[:16] == SUM


@pytest.mark.parametrize("kind", KINDS)
def test_normals_are_of_unit_length_and_face_as_the_triangles_do(kind):
    for number in NUMBERS:
        mesh = piece(kind, number)
        normals = np.concatenate([part.normals for part in mesh])
        np.testing.assert_allclose(np.linalg.norm(normals, axis=2), 1.0, atol=1e-6)
        a, b, c = triangles_of(mesh).swapaxes(0, 1)
        wound = np.cross(b - a, c - a)
        area = np.linalg.norm(wound, axis=1)
        # Where a surface is creased, a sliver may disagree; hardly any area may.
        against = area[(wound * normals.mean(axis=1)).sum(axis=1) <= 0.0].sum()
        assert against < 0.005 * area.sum(), (number, against / area.sum())


def area(part):
    edges = part.positions[:, 1:] - part.positions[:, :1]
    return float(np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1).sum() / 2.0)


def test_subdividing_keeps_area_and_bounds_edges():
    part = quad((0, 0, 0), (2.0, 0, 0), (0, 1.0, 0), Material())
    fine = subdivided(part, 0.3)
    edges = np.linalg.norm(fine.positions[:, [1, 2, 0]] - fine.positions, axis=2)
    assert edges.max() <= 0.3
    assert area(fine) == pytest.approx(2.0)
    assert fine.uv[..., 0].max() == pytest.approx(2.0)


def test_obj_is_scaled_and_turned_to_rep103():
    """A wedge with its tip to the model's front (+z of the file): metres, front along +x, file's x to the left."""
    text = "mtllib m.mtl\nv -1 0 -1\nv 1 0 -1\nv 0 0 3\nv 0 2 -1\nusemtl red\nf 1 2 3\nf 1 4 2\nf 1 3 4\nf 2 4 3\n"
    data = io.BytesIO()
    with zipfile.ZipFile(data, "w") as archive:
        archive.writestr("a/b.obj", text)
        archive.writestr("a/m.mtl", "newmtl red\nKd 1 0 0\n")
    mesh = read_obj(zipfile.ZipFile(data), "a/b.obj", (1, 0, 0, 0, 1, 0, 0, 0, 1), (0.5, 0.8, 1.2))
    points = triangles_of(mesh).reshape(-1, 3)
    np.testing.assert_allclose(points.min(axis=0), [-0.6, -0.25, 0.0], atol=1e-12)
    np.testing.assert_allclose(points.max(axis=0), [0.6, 0.25, 0.8], atol=1e-12)
    tip = points[points[:, 0].argmax()]
    np.testing.assert_allclose(tip, [0.6, 0.0, 0.0], atol=1e-12)
    assert mesh[0].material.colour == pytest.approx((1.0, 0.0, 0.0))
