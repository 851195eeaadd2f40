import json
from dataclasses import replace

import numpy as np
import pytest

from edgemap.geometry.errors import MapError
from edgemap.geometry.objects.floor_map import FloorMap
from edgemap.runtime.step.map_file import load_map, map_document, map_text, read_map, save_map


@pytest.fixture
def objects(placed):
    chairs = FloorMap()
    for frame in range(8):
        chairs.update([placed("chair", 2.0, 0.5, frame), placed("couch", 3.0, -1.0, frame)])
    return chairs.objects()


def test_a_covariance_that_rounds_to_two_values_reads_back(objects):
    odd = np.array([[29.0, 15.02238263051], [15.02238263049, 110.0]])  # the fuzz of edits made such a one
    read, _ = read_map(map_text([replace(objects[0], covariance_m2=odd)]).encode(), "map")
    np.testing.assert_allclose(read[0].covariance_m2, odd)


def test_the_document_is_the_contract(objects):
    document = json.loads(json.dumps(map_document(objects)))
    assert document["format"] == "edgemap.map/1"
    assert document["frame"] == "map"
    assert set(document["objects"][0]) == {
        "id", "label", "x_m", "y_m", "covariance_m2", "width_m", "height_m", "count", "confidence", "first_seen_s",
        "last_seen_s", "labels", "first_seen", "last_seen", "since", "earlier", "history", "yaw_rad", "yaw_sigma_rad",
        "footprint",
    }  # fmt: skip
    assert document["objects"][0]["labels"] == {"chair": 1.0}
    assert document["objects"][0]["id"] == "chair-1"
    assert document["objects"][0]["last_seen_s"] == pytest.approx(0.7)
    assert np.linalg.eigvalsh(document["objects"][0]["covariance_m2"]).min() > 0


def test_a_failed_save_keeps_the_old_map(tmp_path, objects, monkeypatch):
    save_map(tmp_path / "map.json", objects)
    monkeypatch.setattr("os.fsync", lambda _: (_ for _ in ()).throw(OSError(28, "No space left on device")))
    with pytest.raises(MapError, match="No space left"):
        save_map(tmp_path / "map.json", [])
    monkeypatch.undo()
    assert len(load_map(tmp_path)) == 2
    assert [path.name for path in tmp_path.iterdir()] == ["map.json"]
