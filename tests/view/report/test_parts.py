"""What the report gathers while it drives, and how it draws: by hand-made steps."""

import math
import re
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest

from edgemap.geometry.map_object import CHI2_95, MapObject
from edgemap.geometry.observations.detections import Detections
from edgemap.geometry.se2 import SE2
from edgemap.runtime.step.pose_journal import PoseJournal
from edgemap.view.report.charts import duration, nice_top
from edgemap.view.report.crops import MAXIMUM_CROPS, SIDE_PX, BestCrops
from edgemap.view.report.floor_svg import floor_svg
from edgemap.view.report.history import MAX_POSES, MAX_WINDOWS, History
from edgemap.view.report.markup import prose

NOISE = np.random.default_rng(1).integers(0, 255, (480, 640, 3), dtype=np.uint8)
SMOOTH = np.asarray(cv2.GaussianBlur(NOISE, (0, 0), 8), np.uint8)


def seen(identity, box, score=0.8, image=NOISE, index=0) -> Any:
    """A step with one sighting, as far as the crops look at it."""
    detections = Detections(np.array([box], float), np.array([score]), np.zeros(1, np.int64), ("chair",))
    return SimpleNamespace(
        frame=SimpleNamespace(image=image, index=index),
        detections=detections,
        sightings=[SimpleNamespace(sighting=SimpleNamespace(detection=0, score=score))],
        object_ids=[identity],
    )


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
    assert picture is not None
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


def step(journal, index, labels=("chair",), lap_ms=2.0, x_m=0.0, travelled_m=0.0) -> Any:
    detections = Detections(
        np.zeros((len(labels), 4)), np.ones(len(labels)), np.arange(len(labels), dtype=np.int64), tuple(labels)
    )
    journal.append(index / 10, SE2(x_m, 0, 0))
    return SimpleNamespace(
        frame=SimpleNamespace(stamp_s=index / 10),
        pose_map_base=SE2(x_m, 0, 0),
        pose_covariance=np.diag([0.04, 0.01, 0.0]),
        stages_ms={"backbone": lap_ms, "map": 1.0},
        detections=detections,
        trajectory=journal,
        travelled_m=travelled_m,
    )


def test_a_history_is_bounded_and_loses_no_sum():
    history, journal, count = History(), PoseJournal(), 20_001
    for index in range(count):
        driven_m = 0.001 * index
        history.add(step(journal, index, ("chair",), 50.0 if index == 777 else 2.0, driven_m, driven_m))
    assert len(history.trajectory()) <= 2 * MAX_POSES + 1
    assert len(history.windows) <= 2 * MAX_WINDOWS
    assert sum(one.frames for one in history.windows) == count
    assert sum(one.seen["chair"] for one in history.windows) == count
    assert sum(one.stages_ms["map"] for one in history.windows) == pytest.approx(count)
    assert max(one.worst_ms for one in history.windows) == 51.0
    assert history.path_m == pytest.approx(20.0)
    way = history.trajectory()
    assert (way[0].stamp_s, way[-1].stamp_s) == (0.0, 2000.0)
    gaps = np.diff([stop.stamp_s for stop in way[:-1]])
    assert gaps.min() == pytest.approx(gaps.max())
    assert way[0].bound_m == pytest.approx(math.sqrt(CHI2_95 * 0.04))


def test_a_way_that_finds_its_saved_map_is_told_in_that_map():
    history, journal = History(), PoseJournal()
    history.add(step(journal, 0))
    history.add(step(journal, 1, x_m=1.0))
    journal.transform(SE2(7.0, 2.0, 0.0))
    history.add(step(journal, 2, x_m=9.0, travelled_m=1.0))
    assert [(stop.pose_map_base.x_m, stop.pose_map_base.y_m) for stop in history.trajectory()] == [
        (7, 2),
        (8, 2),
        (9, 0),
    ]
    assert history.path_m == 1.0


def item(identity, x, y, covariance):
    label = identity.rpartition("-")[0]
    return MapObject(identity, label, np.array([x, y]), np.array(covariance), 0.5, 0.9, 9, 1.0, 0.0, 1.0)


def test_forward_is_up_and_left_is_left():
    """An object 2 m ahead and one 2 m to the left: the first is drawn above the start, the second left of it."""
    svg = floor_svg(
        [item("chair-1", 2, 0, np.eye(2) * 0.01), item("chair-2", 0, 2, np.eye(2) * 0.01)], [SE2(), SE2(0.5, 0, 0)]
    )
    drawn = re.findall(r'<circle cx="([\d.]+)" cy="([\d.]+)" r="5" class="spot"', svg)
    spots = [tuple(map(float, found)) for found in drawn]
    start = tuple(map(float, re.findall(r'cx="([\d.]+)" cy="([\d.]+)" r="6" class="start"', svg)[0]))
    (ahead_x, ahead_y), (left_x, left_y) = spots
    assert ahead_x == pytest.approx(start[0], abs=0.2)
    assert left_y == pytest.approx(start[1], abs=0.2)
    assert start[1] - ahead_y == pytest.approx(start[0] - left_x, abs=0.2)
    assert start[1] - ahead_y > 50


def test_doubtful_objects_are_drawn_in_outline():
    sure, vague = item("chair-1", 2, 0, np.eye(2) * 0.01), item("chair-2", 0, 2, np.eye(2))
    svg = floor_svg([sure, vague], [])
    assert svg.count('class="object"') == svg.count('class="object doubtful"') == 1
    assert svg.count('class="name doubtful"') == 1


def test_commands_in_a_sentence_are_code():
    assert prose("Run `a < b`, or `c`.") == "Run <code>a &lt; b</code>, or <code>c</code>."
    assert prose("none") == "none"


def test_the_ellipse_lies_along_its_uncertainty():
    """Long along x + y (ahead and to the left): in the drawing that runs from lower right to upper left."""
    along = np.array([1.0, 1.0]) / math.sqrt(2)
    svg = floor_svg([item("a-1", 1, 0, 0.04 * np.outer(along, along) + 0.0001 * np.eye(2))], [])
    rx, ry = map(float, re.findall(r'rx="([\d.]+)" ry="([\d.]+)"', svg)[0])
    angle = math.radians(float(re.findall(r"rotate\((-?[\d.]+)\)", svg)[0]))
    assert rx / ry == pytest.approx(math.sqrt(0.0401 / 0.0001), rel=0.03)
    right, down = math.cos(angle), math.sin(angle)
    assert right * down > 0  # right goes with down


@pytest.mark.parametrize(("seconds", "text"), [(0, "0 s"), (19.9, "19.9 s"), (125, "2:05 min"), (7260, "2:01 h")])
def test_durations(seconds, text):
    assert duration(seconds) == text


@pytest.mark.parametrize(
    ("value", "top"), [(0.24, 0.24), (0.051, 0.06), (3.0, 3.0), (10.0, 10.0), (0.0, 1.0), (26, 30.0)]
)
def test_axes_end_at_round_numbers_near_the_data(value, top):
    assert nice_top(value) == pytest.approx(top)
