"""What the report gathers while it drives, by hand-made steps; how it embeds its data."""

import json
from itertools import pairwise
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from edgemap.geometry.map_object import CHI2_95
from edgemap.geometry.observations.detections import Detections
from edgemap.geometry.se2 import SE2
from edgemap.runtime.step.pose_journal import PoseJournal
from edgemap.view.report import page as page_module
from edgemap.view.report.crops import MAXIMUM_CROPS, SIDE_PX, BestCrops
from edgemap.view.report.history import MAX_POSES, MAX_STILLS, MAX_WINDOWS, History
from edgemap.view.report.page import bundled, report_page

NOISE = np.random.default_rng(1).integers(0, 255, (480, 640, 3), dtype=np.uint8)
SMOOTH = np.asarray(cv2.GaussianBlur(NOISE, (0, 0), 8), np.uint8)


def seen(identity, box, score=0.8, image=NOISE, index=0) -> Any:
    """A step with one sighting, as far as the crops look at it."""
    detections = Detections(np.array([box], float), np.array([score]), np.zeros(1, np.int64), ("chair",))
    frame = SimpleNamespace(image=image, index=index)
    return SimpleNamespace(
        frame=frame, pictured=frame, detections=detections,
        sightings=[SimpleNamespace(sighting=SimpleNamespace(detection=0, score=score))], object_ids=[identity],
    )  # fmt: skip


WHOLE, CUT, SMALL = (100, 100, 200, 300), (540, 100, 640, 300), (100, 100, 130, 150)


@pytest.mark.parametrize(
    ("worse", "better"),
    [
        (seen("a-1", SMALL, index=1), seen("a-1", WHOLE, index=2)),
        (seen("a-1", CUT, index=1), seen("a-1", WHOLE, index=2)),
        (seen("a-1", WHOLE, 0.4, index=1), seen("a-1", WHOLE, 0.9, index=2)),
        (seen("a-1", WHOLE, image=SMOOTH, index=1), seen("a-1", WHOLE, index=2)),
    ],
    ids=["small", "cut", "unsure", "blurred"],
)
def test_the_better_picture_stays_in_either_order(worse, better):
    for order in ((worse, better), (better, worse)):
        crops = BestCrops()
        for step in order:
            crops.consider(step)
        assert crops.of(["a-1"])["a-1"].frame == 2


def test_a_picture_is_small_and_shows_the_box_with_a_margin():
    crops = BestCrops()
    crops.consider(seen("a-1", (100, 50, 300, 450)))
    picture = cv2.imdecode(np.frombuffer(crops.of(["a-1"])["a-1"].jpeg, np.uint8), cv2.IMREAD_COLOR)
    assert picture.shape[0] == SIDE_PX
    assert picture.shape[1] == pytest.approx(SIDE_PX * 240 / 470, abs=1)  # 480 tall, cut by the picture's lower border


def test_merged_objects_hand_on_their_picture_and_memory_is_bounded():
    crops = BestCrops()
    crops.consider(seen("a-1", SMALL, index=1))
    crops.consider(seen("a-2", WHOLE, index=2))
    crops.keep({"a-1"}, {"a-2": "a-1"})
    assert crops.of(["a-1", "a-2"]).keys() == {"a-1"}
    assert crops.of(["a-1"])["a-1"].frame == 2
    for number in range(MAXIMUM_CROPS + 50):
        crops.consider(seen(f"b-{number}", SMALL, index=9))
    crops.keep({"a-1", "b-7"}, {})
    assert len(crops) == MAXIMUM_CROPS
    assert crops.of(["a-1", "b-7"]).keys() == {"a-1", "b-7"}


PLAIN = np.zeros((240, 320, 3), np.uint8)


def step(journal, index, lap_ms=2.0, x_m=0.0, travelled_m=0.0) -> Any:
    detections = Detections(np.zeros((1, 4)), np.ones(1), np.zeros(1, dtype=np.int64), ("chair",))
    journal.append(index / 10, SE2(x_m, 0, 0))
    return SimpleNamespace(
        frame=SimpleNamespace(stamp_s=index / 10, index=index, image=PLAIN), sightings=[], object_ids=[],
        pose_covariance=np.diag([0.04, 0.01, 0.0]), stages_ms={"backbone": lap_ms, "map": 1.0}, scale=1.0,
        detections=detections, trajectory=journal, travelled_m=travelled_m,
    )  # fmt: skip


def test_a_history_is_bounded_and_loses_no_sum():
    history, journal, count = History(), PoseJournal(), 20_001
    for index in range(count):
        history.add(step(journal, index, 50.0 if index == 777 else 2.0, 0.001 * index, 0.001 * index))
    trail = np.array(history.trail())
    assert len(trail) <= 2 * MAX_POSES + 1
    assert len(history.windows) <= 2 * MAX_WINDOWS
    assert MAX_STILLS <= len(history.stills) <= 2 * MAX_STILLS
    assert len({round(b.stamp_s - a.stamp_s, 6) for a, b in pairwise(history.stills)}) == 1
    assert sum(one.frames for one in history.windows) == history.detected["chair"] == count
    assert sum(one.stages_ms["map"] for one in history.windows) == pytest.approx(count)
    assert max(one.worst_ms for one in history.windows) == 51.0
    assert trail[[0, -1], 2].tolist() == [0.0, 2000.0]
    gaps = np.diff(trail[:-1, 2])
    assert gaps.min() == pytest.approx(gaps.max())
    np.testing.assert_allclose(trail[:, 3], np.sqrt(CHI2_95 * 0.04))


def test_a_module_that_cannot_be_bundled_is_named(tmp_path, monkeypatch):
    monkeypatch.setattr(page_module, "STATIC", tmp_path)
    (tmp_path / "a.js").write_text("export default 1;\n")
    with pytest.raises(ValueError, match=r"a\.js: an import or export that cannot be bundled"):
        bundled("a")


ANY_TEXT = st.text(st.characters()) | st.sampled_from(["</script><script>", "<!--", "]]>", "\u2028", "\ud800"])
VALUES = st.recursive(
    ANY_TEXT | st.integers(-(2**53), 2**53) | st.booleans() | st.none(),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(ANY_TEXT, inner, max_size=4),
    max_leaves=12,
)


@given(VALUES)
def test_whatever_is_embedded_is_read_back_and_ends_no_element(value):
    page = report_page({"about": {"camera": "made"}, "value": value, "nan": float("nan")})
    data = page.partition('<script id="run-data" type="application/json">')[2].partition("</script>")[0]
    assert "<" not in data
    assert json.loads(data) == {"about": {"camera": "made"}, "value": value, "nan": None}
    page.encode()  # no half of a character is left
