"""`edgemap map approach` as a user types it."""

import json
from dataclasses import replace

import numpy as np
import pytest
from support.rooms import mapped

from edgemap.geometry.grid.occupancy_grid import OccupancyGrid
from edgemap.geometry.objects.annotations import NO_ANNOTATIONS
from edgemap.runtime.step.map_file import save_map


@pytest.fixture
def room(tmp_path):
    near, far = mapped([("chair", 2.0, 0.0), ("chair", 2.0, 2.0)])
    free = OccupancyGrid(np.full((200, 200), -100, np.int8), -5.0, -5.0, 0.05)
    save_map(tmp_path / "map.json", [replace(near, name="blue chair"), far], NO_ANNOTATIONS, free)
    return tmp_path / "map.json"


@pytest.mark.parametrize(
    ("asked", "expected"),
    [
        (("chair-2",), "chair-2"),
        (("blue chair",), "chair-1"),
        (("--label", "chair", "--near", "2,3"), "chair-2"),
        (("--label", "chair"), "chair-1"),
    ],
)
def test_a_pose_before_an_object(edgemap, room, asked, expected):
    done = edgemap("map", "approach", room, *asked, "--json")
    assert done.returncode == 0, done.stderr
    document = json.loads(done.stdout)
    assert (document["object"], document["frame"], document["floor"]) == (expected, "map", "free")
    assert document["standoff_m"] == 0.4


def test_in_words(edgemap, room):
    done = edgemap("map", "approach", room, "chair-1", "--near", "0,0")
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("chair-1: x 1.")
    assert "yaw 0.0 deg; 0.40 m before it, free floor" in done.stdout
