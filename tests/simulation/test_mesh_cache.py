"""Meshes on disk: what comes back is what was put there, to the bit; anything else on disk is made anew."""

import os

import numpy as np
import pytest

from edgemap.simulation.apartment.mesh_cache import kept
from edgemap.simulation.render.mesh import Material, Mesh, Part, box


@pytest.fixture
def place(tmp_path, monkeypatch):
    """(library, file of the mesh) in a cache of the test's own."""
    monkeypatch.setenv("EDGEMAP_CACHE", str(tmp_path / "cache"))
    library = tmp_path / "Library.sh3f"
    library.write_bytes(b"chairs")
    return library, tmp_path / "cache" / "meshes" / "Library-chair.npz"


def chair():
    """Odd numbers, one texture on two parts, another that only looks alike, and all that a material has."""
    rng = np.random.default_rng(4)
    woven, alike = (np.full((3, 5, 4), 200, np.uint8) for _ in range(2))
    materials = (
        Material((1.0, 1.0, 1.0), woven, gloss=0.1 + 0.2),
        Material((1 / 3, 0.7, 1.0), woven, opacity=0.4),
        Material((1.0, 1.0, 1.0), alike, gloss=0.3),
        Material((0.1, 0.2, 0.3), emission=(3.0, 2.0, 1 / 7), group="day"),
    )
    parts = [
        Part(material, rng.normal(size=(7, 3, 3)), rng.normal(size=(7, 3, 3)), rng.normal(size=(7, 3, 2)))
        for material in materials
    ]
    shell = box((-0.1, -0.2, 0.0), (0.1, 0.2, 0.7), Material()).parts[2]
    return Mesh((*parts, Part(shell.material, -shell.positions, -0.0 * shell.normals, shell.uv)))


def made_never():
    raise AssertionError("it lies there already")


def assert_alike(found, expected):
    for one, other in zip(found.parts, expected.parts, strict=True):
        for name in ("positions", "normals", "uv"):
            assert getattr(one, name).tobytes() == getattr(other, name).tobytes()
        for name in ("colour", "opacity", "gloss", "emission", "group"):
            assert getattr(one.material, name) == getattr(other.material, name)
        assert (one.material.texture is None) == (other.material.texture is None)
        if one.material.texture is not None:
            np.testing.assert_array_equal(one.material.texture, other.material.texture)


def test_a_kept_mesh_is_the_same_to_the_bit(place):
    library, path = place
    expected = chair()
    assert kept("Library/chair", library, 9000, lambda: expected) is expected
    assert path.is_file()
    found = kept("Library/chair", library, 9000, made_never)
    assert_alike(found, expected)
    woven, again, alike = (part.material.texture for part in found.parts[:3])
    assert woven is again
    assert woven is not alike
    assert [file.name for file in path.parent.iterdir()] == ["Library-chair.npz"]


@pytest.mark.parametrize("change", ["size", "time", "triangles", "version"])
def test_a_mesh_of_something_else_is_made_anew(place, monkeypatch, change):
    library, _ = place
    kept("Library/chair", library, 9000, chair)
    about = library.stat()
    if change == "size":
        library.write_bytes(b"chairs and tables")
        os.utime(library, ns=(about.st_atime_ns, about.st_mtime_ns))
    if change == "time":
        os.utime(library, ns=(about.st_atime_ns, about.st_mtime_ns + 1))
    if change == "version":
        monkeypatch.setattr("edgemap.simulation.apartment.mesh_cache.VERSION", 99)
    most, other = 8000 if change == "triangles" else 9000, chair()
    assert kept("Library/chair", library, most, lambda: other) is other
    assert_alike(kept("Library/chair", library, most, made_never), other)


@pytest.mark.parametrize("damage", ["cut", "flipped", "text", "empty", "other arrays"])
def test_a_damaged_file_is_made_anew(place, damage):
    library, path = place
    kept("Library/chair", library, 9000, chair)
    whole = path.read_bytes()
    if damage == "flipped":
        middle = len(whole) // 2
        path.write_bytes(whole[:middle] + bytes([whole[middle] ^ 0xFF]) + whole[middle + 1 :])
    elif damage == "other arrays":
        np.savez(path, stamp=np.arange(3))
    else:
        path.write_bytes({"cut": whole[: len(whole) // 2], "text": b"no mesh", "empty": b""}[damage])
    other = chair()
    assert kept("Library/chair", library, 9000, lambda: other) is other
    assert_alike(kept("Library/chair", library, 9000, made_never), other)


def test_where_nothing_can_be_written_nothing_is_kept(place, monkeypatch, tmp_path):
    library, _ = place
    (tmp_path / "file").write_bytes(b"")
    monkeypatch.setenv("EDGEMAP_CACHE", str(tmp_path / "file"))
    expected = chair()
    assert kept("Library/chair", library, 9000, lambda: expected) is expected
