"""A grid file by an attacker: one line, and no memory for what its headers promise."""

import io
import json
import tracemalloc
import zipfile
from contextlib import suppress

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from edgemap.geometry.errors import MapError
from edgemap.geometry.grid.occupancy_grid import OccupancyGrid
from edgemap.runtime.step.grid_file import load_grid, read_grid, save_grid

GOOD = OccupancyGrid(np.arange(-60, 60, dtype=np.int8).reshape(10, 12), -0.5, 1.0, 0.05)


def archive(**members):
    """A zip of .npy files, deflated."""
    data = io.BytesIO()
    with zipfile.ZipFile(data, "w", zipfile.ZIP_DEFLATED) as file:
        for name, content in members.items():
            file.writestr(f"{name}.npy", content)
    return data.getvalue()


def npy(array, allow_pickle=False):
    data = io.BytesIO()
    np.save(data, array, allow_pickle=allow_pickle)
    return data.getvalue()


def members(**changed):
    whole = {
        "log_odds": npy(GOOD.log_odds),
        "origin_m": npy(np.array([-0.5, 1.0])),
        "resolution_m": npy(np.array(0.05)),
        "thresholds": npy(np.array([-1.1, 0.6])),
    }
    return {name: value for name, value in (whole | changed).items() if value is not None}


def header(shape, dtype="|i1"):
    data = io.BytesIO()
    np.lib.format.write_array_header_1_0(data, {"descr": dtype, "fortran_order": False, "shape": shape})
    return data.getvalue()


def test_a_good_file_is_read(tmp_path):
    save_grid(tmp_path / "grid.npz", GOOD)
    back = read_grid((tmp_path / "grid.npz").read_bytes(), "grid.npz")
    assert (back.log_odds == GOOD.log_odds).all()
    assert (back.x_m, back.y_m) == (-0.5, 1.0)
    assert read_grid(archive(**members()), "made").cells.shape == (10, 12)


@pytest.mark.parametrize(
    "changed",
    [
        {"log_odds": None},
        {"log_odds": header((8192, 8192))},
        {"log_odds": header((10**9, 10**9))},
        {"log_odds": npy(np.zeros((9000, 2), np.int8))},
        {"log_odds": npy(np.zeros((0, 5), np.int8))},
        {"log_odds": npy(np.zeros(5, np.int8))},
        {"log_odds": npy(np.zeros((5, 5), np.float64))},
        {"log_odds": npy(np.asfortranarray(np.zeros((5, 6), np.int8)))},
        {"log_odds": npy(np.array([[object()]]), allow_pickle=True)},
        {"log_odds": b"\x93NUMPY\x01\x00\xff\xff" + b"[" * 5000},
        {"log_odds": b"\x93NUMPY\x02\x00"},
        {"origin_m": npy(np.array([np.nan, 0.0]))},
        {"origin_m": npy(np.array([1e9, 0.0]))},
        {"origin_m": npy(np.zeros(3))},
        {"resolution_m": npy(np.array(0.0))},
        {"resolution_m": npy(np.array(np.inf))},
        {"thresholds": npy(np.array([1.0, -1.0]))},
        {"thresholds": npy(np.array([np.nan, 1.0]))},
    ],
)
def test_what_is_no_grid_is_refused_in_one_line(changed):
    with pytest.raises(MapError) as error:
        read_grid(archive(**members(**changed)), "stick/grid.npz")
    assert str(error.value).startswith("stick/grid.npz: no grid")
    assert "\n" not in str(error.value)


def test_a_small_file_of_many_bytes_takes_no_memory_for_them():
    bomb = archive(**members(log_odds=header((8192, 8191)) + bytes(400 << 20)))
    assert len(bomb) < 1 << 20
    tracemalloc.start()
    with pytest.raises(MapError, match="at most"):
        read_grid(bomb, "bomb")
    assert tracemalloc.get_traced_memory()[1] < 8 << 20
    tracemalloc.stop()


@pytest.mark.parametrize("name", ["../grid.npz", "/etc/passwd", "a/grid.npz", "..", "a\\b.npz", ""])
def test_a_name_that_leaves_the_folder_is_refused(tmp_path, name):
    text = json.dumps({"format": "edgemap.map/1", "objects": [], "grid": name})
    (tmp_path / "map.json").write_text(text)
    with pytest.raises(MapError):
        load_grid(tmp_path)


@settings(max_examples=150, deadline=None)
@given(st.data())
def test_a_damaged_file_is_read_or_refused(data):
    whole = bytearray(archive(**members()))
    for _ in range(data.draw(st.integers(1, 4))):
        whole[data.draw(st.integers(0, len(whole) - 1))] = data.draw(st.integers(0, 255))
    cut = data.draw(st.integers(0, len(whole)))
    for damaged in (bytes(whole), bytes(whole[:cut])):
        with suppress(MapError):
            assert read_grid(damaged, "damaged").cells.size
