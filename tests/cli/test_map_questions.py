"""`edgemap map show` with questions: which objects, how near, inside what, seen since when."""

import json

import cv2
import numpy as np
import pytest

from edgemap.geometry.map_object import MapEvent, MapObject
from edgemap.geometry.objects.annotations import Annotations, MapIdentity
from edgemap.runtime.step.map_file import save_map


@pytest.fixture
def room(tmp_path):
    def item(identity, x, y, last_s):
        label = identity.rpartition("-")[0]
        return MapObject(identity, label, np.array([x, y]), np.eye(2) * 0.01, 0.5, 0.9, 9, 0.9, 0.0, last_s)

    things = [item("chair-1", 3.0, 0.0, 5.0), item("chair-2", -1.0, 0.5, 9.0), item("couch-1", 1.0, 1.0, 7.0)]
    save_map(tmp_path / "room.json", things)
    return tmp_path / "room.json"


@pytest.mark.parametrize(
    ("question", "expected"),
    [
        (("--label", "chair", "--near", "-2,0.5"), [("chair-2", 1.0), ("chair-1", 5.024938)]),
        (("--near", "0,0"), [("chair-2", 1.118034), ("couch-1", 1.414214), ("chair-1", 3.0)]),
        (("--inside", "0,-1;4,-1;4,2;0,2"), [("chair-1", None), ("couch-1", None)]),
        (("--inside=-2,0;2,0;2,2;-2,2", "--since", "8"), [("chair-2", None)]),
        (("--label", "couch,bed"), [("couch-1", None)]),
        (("--label", "bed"), []),
        ((), [("chair-1", None), ("chair-2", None), ("couch-1", None)]),
    ],
)
def test_answers_as_one_json_document(edgemap, room, question, expected):
    result = edgemap("map", "show", room, *question, "--json")
    assert result.returncode == 0, result.stderr
    document = json.loads(result.stdout)
    assert document["format"] == "edgemap.map/1"
    assert [(item["id"], item.get("distance_m")) for item in document["objects"]] == expected
    assert not room.with_suffix(".png").exists()


def test_answers_as_text_draw_only_on_request(edgemap, room, tmp_path):
    result = edgemap("map", "show", room, "--label", "chair", "--near", "3,0")
    lines = result.stdout.splitlines()
    assert lines[0].startswith("chair-1")
    assert lines[0].endswith("0.00 m away")
    assert lines[-1] == "2 of 3 objects"
    assert not room.with_suffix(".png").exists()
    result = edgemap("map", "show", room, "--label", "chair", "-o", tmp_path / "some.png")
    assert "2 of 3 objects; drawn in" in result.stdout
    assert cv2.imread(str(tmp_path / "some.png")) is not None


def test_the_history_and_the_verdict_of_any_map(edgemap, tmp_path):
    moved = MapEvent("moved", 1.8e9, from_m=(1.0, 2.0), to_m=(3.0, -1.0), other="chair-1")
    bag = MapObject("chair-2", "chair", np.zeros(2), np.eye(2), 0.5, 0.9, 9, 0.9, 0.0, 1.0, history=(moved,))
    notes = Annotations(identity=MapIdentity("home", 2, level="care", reasons=("dim light",)))
    save_map(tmp_path / "map.json", [bag], notes)
    line = edgemap("map", "show", tmp_path, "--history").stdout
    assert line == "2027-01-15T08:00:00Z  chair-2  moved  (chair-1)  from x 1.00 y 2.00 m  to x 3.00 y -1.00 m\n"
    (change,) = json.loads(edgemap("map", "show", tmp_path, "--history", "--json").stdout)["changes"]
    assert (change["id"], change["what"], change["other"]) == ("chair-2", "moved", "chair-1")
    lines = edgemap("why", tmp_path).stdout.splitlines()
    assert lines[0].startswith(f"{tmp_path}: map: use with care")
    assert "dim light" in lines[1]
