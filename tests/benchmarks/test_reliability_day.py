"""Twenty laps of the day's room with a graph a fifth of the real size: what is held follows the room, not the laps."""

from dataclasses import replace

import numpy as np
import pytest
from reliability.day import RoundTrip

from edgemap.geometry.slam.keyframes import KeyframeRule
from edgemap.geometry.slam.pose_graph import GraphRule
from edgemap.runtime.step.config import Config
from edgemap.runtime.step.mapper import new_mapper

MAXIMUM, LANDMARKS, LAP = 40, 40, 50  # keyframes, landmarks solved for, steps


@pytest.fixture(scope="module")
def laps():
    """After each lap: keyframes, those of the first two laps, landmarks, observations, links so far, objects; and the
    drive."""
    rule = GraphRule(keyframes=KeyframeRule(maximum=MAXIMUM), maximum=LANDMARKS)
    mapper, drive, rows = new_mapper(replace(Config(), loop_closure=rule)), RoundTrip(0), []
    graph = mapper.map.graph
    for step in range(20 * LAP):
        mapper.step(drive.step())
        if step % LAP == LAP - 1:
            stamps = graph.trajectory.stamps_s
            rows.append([
                len(stamps), sum(stamp_s < 2 * LAP for stamp_s in stamps), len(graph.landmarks.all),
                sum(len(one.keyframes) for one in graph.landmarks.all.values()),
                mapper.loop_closer.accepted, len(mapper.objects()),
            ])  # fmt: skip
    return np.array(rows), drive


def test_the_graph_stays_small(laps):
    rows, *_ = laps
    keyframes, _, landmarks, observations, *_ = rows[2:].max(axis=0)
    assert keyframes <= MAXIMUM + 15  # made while a closure is under way
    assert landmarks <= 5 * 16  # three visits of each object, and those since the last closure
    assert observations <= 5 * keyframes  # one sees about four objects, and keeps what those it replaces saw


def test_the_first_laps_stay_what_later_ones_are_known_against(laps):
    rows, *_ = laps
    assert (rows[5:, 1] > MAXIMUM / 6).all()
    found = np.diff(rows[:, 4])
    assert found[-5:].mean() > 0.8 * found[5:10].mean()  # landmarks are found again as often as ever


def test_no_object_stays_doubled(laps):
    """Odometry drifts so much here that a lap may begin objects of its own; the next closure joins them."""
    rows, drive = laps
    objects = rows[:, 5]
    assert np.minimum(objects[1:], objects[:-1]).max() < len(drive.room)
    assert rows[-5:, 2].mean() < 3.5 * len(drive.room)  # three visits of each, and some since the last closure
