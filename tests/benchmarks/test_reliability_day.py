"""Twenty laps of the day's room with a graph a fifth of the real size: what is held follows the room, not the laps."""

from dataclasses import replace

import numpy as np
import pytest

from edgemap.benchmarks.reliability.day import RoundTrip
from edgemap.geometry.objects.floor_map import FloorMap
from edgemap.geometry.slam.keyframes import KeyframeRule
from edgemap.geometry.slam.pose_graph import GraphRule
from edgemap.runtime.config import Config
from edgemap.runtime.loop_closing import LoopCloser
from edgemap.runtime.mapper import new_mapper

MAXIMUM, TRACKS, LAP = 40, 40, 50  # keyframes, tracks, steps


@pytest.fixture(scope="module")
def laps():
    """After each lap: keyframes, those of the first two laps, tracks, observations, links so far, objects, pools; and
    the drive and the mapper."""
    rule = GraphRule(keyframes=KeyframeRule(maximum=MAXIMUM), maximum=TRACKS)
    mapper, drive, rows = new_mapper(replace(Config(), loop_closure=rule)), RoundTrip(0), []
    assert isinstance(mapper.loop_closer, LoopCloser)
    assert isinstance(mapper.map, FloorMap)
    graph = mapper.loop_closer.graph
    for step in range(20 * LAP):
        mapper.step(drive.step())
        if step % LAP == LAP - 1:
            stamps = graph.trajectory.stamps_s
            rows.append([
                len(stamps), sum(stamp_s < 2 * LAP for stamp_s in stamps), len(graph.tracker.tracks),
                len(graph._observations), graph.links, len(mapper.objects()), len(mapper.map._owner),
            ])  # fmt: skip
    return np.array(rows), drive, mapper


def test_the_graph_stays_small(laps):
    rows, *_ = laps
    keyframes, _, tracks, observations, *_ = rows[2:].max(axis=0)
    assert keyframes <= MAXIMUM + 15  # made while a closure is under way
    assert tracks <= TRACKS + 14  # those in view are never dropped
    assert observations <= 4 * keyframes  # a keyframe sees about four objects


def test_the_first_laps_stay_what_later_ones_are_known_against(laps):
    rows, *_ = laps
    assert (rows[5:, 1] > MAXIMUM / 6).all()
    found = np.diff(rows[:, 4])
    assert found[-5:].mean() > 0.8 * found[5:10].mean()  # landmarks are found again as often as ever


def test_no_object_is_doubled(laps):
    rows, drive, _ = laps
    objects, pools = rows[:, 5], rows[:, 6]
    assert objects.max() <= len(drive.room)
    assert pools[-5:].mean() < 1.1 * pools[5:10].mean()


def test_what_most_sightings_of_an_object_went_into_stays_with_its_landmark(laps):
    *_, mapper = laps
    groups = mapper.loop_closer.graph.groups()
    heaviest = [max(item.pools, key=lambda pool: pool.weight) for item in mapper.map._objects.values()]
    known = [pool for pool in heaviest if pool.landmark in groups]
    assert len(known) >= 0.8 * len(heaviest)
    for pool in known:
        assert np.linalg.norm(pool.position_m - groups[pool.landmark][0].position_m) < 0.3
