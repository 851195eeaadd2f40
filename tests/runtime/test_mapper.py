"""What each line of the back end is there for, through the real Mapper: numbers by hand, or the room as it stands."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from support.drifting import drifting, integrated
from support.drives import drive, exact, observed, round_trip
from support.rooms import ROOM, mapped
from support.seen import CAMERA, look

from edgemap.geometry.objects.forgetting import Forgetter, is_crossed
from edgemap.geometry.observations.detections import Detections
from edgemap.geometry.observations.floor_mask import FloorMask
from edgemap.geometry.observations.sighting import FloorRule, Sighting, sightings_of
from edgemap.geometry.se2 import SE2
from edgemap.geometry.slam.keyframes import KeyframeTrajectory
from edgemap.runtime.motion.odometry.protocol import Motion
from edgemap.runtime.step.frame_observations import FrameObservations
from edgemap.runtime.step.mapper import Mapper
from edgemap.runtime.step.relocalisation import SavedMap


def sight(label, x_m, y_m, sigma_m=0.05, index=0):
    """A sighting at a place of the base frame."""
    covariance = np.eye(2) * sigma_m**2
    place = np.array([x_m, y_m])
    return Sighting(label, 0.9, place, covariance, covariance / 4, 0.5, 0.9, 0.5, math.hypot(x_m, y_m), 0, index)


def test_the_odom_pose_is_continuous_where_loop_closure_moves_the_map_pose():
    """REP-105: odom -> base_link is the sum of the motions, whatever map -> odom does meanwhile. Two rounds."""
    poses = round_trip(260, turns=2.4)
    motions = drifting(poses)
    closed, expected = list(drive(Mapper(closes_loops=True), ROOM, poses, motions, 0)), integrated(motions)
    for (result, _), pose in zip(closed, expected, strict=True):
        assert result.pose_odom_base.vector() == pytest.approx(pose.vector(), abs=1e-9)
    assert any(result.correction for result, _ in closed)
    assert math.dist(closed[-1][0].pose_map_base.vector()[:2], expected[-1].vector()[:2]) > 0.01


def test_what_the_pose_drifted_in_between_joins_two_visits_of_one_chair():
    """Seen again after 0.7 m of stated drift, 0.9 m beside: one chair. Had the pose been sure, two."""
    counts = {}
    for sigma_m in (0.7, 0.001):
        mapper = Mapper()
        for index in range(12):
            drift = np.diag([sigma_m**2, sigma_m**2, 0.0]) if index == 6 else np.zeros((3, 3))
            motion = Motion(SE2(0.9, 0.0, 0.0) if index == 6 else SE2(), drift)
            mapper.step(observed(index, [sight("chair", 2.0, 0.0, 0.03, index)], motion))
        objects = mapper.objects()
        counts[sigma_m] = len(objects)
        if len(objects) == 1:  # the visit before the drift says where it stands
            assert objects[0].position_m == pytest.approx([2.0, 0.0], abs=0.1)
    assert counts == {0.7: 1, 0.001: 2}


@pytest.mark.parametrize(
    ("label", "lens_m", "aside_m", "shown"),
    [
        ("bed", 1.6, 0.3, False),  # walked through: it is a carpet
        ("bed", 1.6, 1.0, True),  # 1.6 m wide, passed by
        ("bed", 0.2, 0.3, True),  # a low robot may have been under it
        ("suitcase", 1.6, 0.1, True),  # may have come after the robot
    ],
)
@pytest.mark.parametrize("first", [0, 20])  # seen before the base is there, and after
def test_furniture_on_the_path_of_a_lens_that_is_higher_is_none(label, lens_m, aside_m, shown, first):
    mapper, camera = Mapper(), replace(CAMERA, mount=replace(CAMERA.mount, height_m=lens_m))
    for index in range(30):
        in_view = [sight(label, 2.0 - 0.2 * index, aside_m, index=index)] if first <= index < first + 8 else []
        motion = Motion(SE2(0.2 if index else 0.0, 0.0, 0.0), np.eye(3) * 1e-6)
        mapper.step(replace(observed(index, in_view, motion), camera=camera))
        if first == 0 and index == 5:
            assert [item.label for item in mapper.objects()] == [label]
    assert [item.label for item in mapper.objects()] == [label] * shown


@pytest.mark.parametrize(
    ("own_sigma_m", "pose_sigma_m", "shown"),
    [
        (0.4, 0.001, False),  # the base is 0.6 m within the bed
        (0.8, 0.001, True),
        (0.4, 0.4, False),  # 0.57 m together
        (0.4, 0.6, True),  # 0.72 m
        (0.001, 0.8, True),
    ],
)
def test_furniture_stays_where_it_or_the_path_is_unsure_by_more_than_the_crossing(own_sigma_m, pose_sigma_m, shown):
    bed = replace(mapped([("bed", 1.0, 0.2)])[0], covariance_m2=np.eye(2) * own_sigma_m**2, width_m=1.6)
    path = KeyframeTrajectory()
    path.begin(SE2(), np.diag([0.01, 0.01, 0.01]), 0.0)
    path.advance(SE2(1.0, 0.0, 0.0), np.zeros((3, 3)), 1.0)
    path.covariances = np.array([np.diag([pose_sigma_m**2, pose_sigma_m**2, 0.01])] * 2)
    assert is_crossed(bed, path, 1.6) is not shown


def test_a_saved_map_keeps_the_furniture_that_the_path_crosses():
    """The path may be wrong: the bed of the file stays with its id, the one that only this run observes does not."""
    (bed,) = mapped([("bed", 1.0, 0.2)])
    mapper, camera = Mapper(), replace(CAMERA, mount=replace(CAMERA.mount, height_m=1.6))
    mapper.start_in(SavedMap([bed]), SE2(), (0.01, 0.01, 0.01))
    for index in range(40):
        in_view = [sight("bed", 4.0 - 0.2 * index, 0.2, index=index)] if index < 8 else []
        motion = Motion(SE2(0.2 if index else 0.0, 0.0, 0.0), np.eye(3) * 1e-6)
        mapper.step(replace(observed(index, in_view, motion), camera=camera))
    assert [item.id for item in mapper.map.objects()] == [bed.id, "bed-2"]
    assert [item.id for item in mapper.objects()] == [bed.id]


@pytest.mark.parametrize(("floor", "stays"), [(1.0, False), (0.0, True)])
def test_a_saved_chair_leaves_where_floor_is_seen_in_its_place_from_a_side_it_was_never_seen_from(floor, stays):
    """The first drive saw it along x; the second one comes along y, where a wall could stand between: no detection is
    no evidence there, but floor in its place is, as no wall hides it then."""
    random, chair = np.random.default_rng(0), [("chair", 2.0, 0.0)]
    first = Mapper()
    for frame in range(20):
        boxes = look(chair, SE2(), random, 1.0)[0]
        sightings = sightings_of(boxes, CAMERA, FloorRule(), frame, frame / 10)
        first.step(FrameObservations(frame, frame / 10, boxes, sightings, Motion(SE2(), np.zeros((3, 3)))))
    second, nothing = Mapper(forgetter=Forgetter(CAMERA)), Detections.none(("chair",))
    second.start_in(SavedMap(first.objects()), SE2(2.0, -2.5, math.pi / 2.0), (0.01, 0.01, 0.01))
    mask = FloorMask(np.full((48, 64), floor, dtype=np.float32), 640, 480)
    for frame in range(12):
        motion = Motion(SE2(0.0 if frame % 2 else 0.2, 0.0, 0.0) if frame < 2 else SE2(0.0, 0.0, 0.2 * (-1) ** frame))
        second.step(FrameObservations(frame, frame / 10, nothing, [], motion, camera=CAMERA, floor=mask))
    assert [item.label for item in second.objects()] == ["chair"] * stays


def test_what_stands_there_now_replaces_what_a_saved_map_has_in_its_place():
    """A saved suitcase of 30 sightings, and a plant that ten pictures show where it stood; two are no reason yet."""
    (suitcase,) = mapped([("suitcase", 2.0, 0.0)])
    for pictures, label in ((2, "suitcase"), (10, "potted plant")):
        mapper = Mapper()
        mapper.start_in(SavedMap([replace(suitcase, count=30)]), SE2(), (0.01, 0.01, 0.01))
        for index in range(pictures):
            found = [sight("potted plant", 2.05, 0.0, index=index)]
            mapper.step(observed(index, found, Motion(SE2(), np.zeros((3, 3)))))
        assert [item.label for item in mapper.objects()] == [label]


def test_the_alignment_is_part_of_the_pose_covariance_after_relocalisation():
    """By hand: the alignment's covariance reaches the robot over its lever arm; the drive's own part is turned."""
    *_, (_, saved) = drive(Mapper(), ROOM, (poses := round_trip(80)), exact(poses), 7)
    poses = round_trip(80, start_rad=2.0)
    mapper = Mapper()
    mapper.relocalise_in(SavedMap(saved))
    motions = [Motion(motion.motion, np.diag([1e-6, 1e-6, 1e-7])) for motion in exact(poses)]
    before = None
    for result, _ in drive(mapper, ROOM, poses, motions, 1):
        if result.relocated is not None:
            break
        before = result
    alignment = mapper.relocaliser.alignment
    own = alignment.pose_a_b.inverse() @ result.pose_map_base
    x_m, y_m = alignment.pose_a_b.rotation() @ [own.x_m, own.y_m]
    lever = np.array([[1.0, 0.0, -y_m], [0.0, 1.0, x_m], [0.0, 0.0, 1.0]])
    excess = result.pose_covariance - lever @ alignment.covariance @ lever.T
    assert np.linalg.eigvalsh(alignment.covariance).min() > 1e-6
    assert np.linalg.eigvalsh(excess).min() > -1e-9  # at least the alignment's
    assert np.trace(excess) < 2.0 * np.trace(before.pose_covariance) + 1e-4  # and the drive's own little


def test_a_motion_without_a_picture_follows_the_pose():
    """Up to two of them, after a turn: they are in the frame of the pose before, which is less and less certain."""
    turned, ahead, traces = SE2(1.0, 0.5, 0.8), SE2(0.3, 0.1, 0.2), [0.0]
    expected = turned
    for blind in range(3):
        mapper = Mapper()
        for index, motion in enumerate(exact([SE2(), turned])):
            mapper.step(observed(index, [], motion))
        for _ in range(blind):
            mapper.step_blind(Motion(ahead, 1e-4 * np.eye(3)))
        after = mapper.step(observed(2, [], Motion(ahead, 1e-4 * np.eye(3))))
        expected @= ahead
        assert after.pose_map_base.vector() == pytest.approx(expected.vector())
        traces.append(after.pose_covariance.trace())
    assert traces == sorted(set(traces))


ODD = math.nan, math.inf, -math.inf, 1e300, -1e300, 0.0, 1e9, -1e9, 1e-320
WILD = st.one_of(st.floats(-3.0, 3.0), st.sampled_from(ODD))
TAME = st.floats(-0.3, 0.3)
SPREAD = st.one_of(st.floats(1e-4, 0.5), st.sampled_from([0.0, -1.0, math.nan, math.inf, 1e300]))


@st.composite
def motions(draw):
    values = draw(st.one_of(st.tuples(TAME, TAME, TAME), st.tuples(WILD, WILD, WILD)))
    covariance = np.diag([draw(SPREAD), draw(SPREAD), draw(SPREAD)])
    covariance[0, 1] = draw(st.sampled_from([0.0, 0.0, 0.01, 5.0, math.nan]))
    covariance[1, 0] = draw(st.sampled_from([covariance[0, 1], 0.0]))
    with np.errstate(invalid="ignore"):
        try:
            return Motion(SE2(*values), covariance)
        except ValueError:  # of an infinite angle
            return Motion(SE2(values[0], values[1], 0.0), covariance)


@st.composite
def sightings(draw):
    place = np.array([draw(st.one_of(st.floats(0.5, 4.0), WILD)), draw(st.one_of(st.floats(-2.0, 2.0), WILD))])
    own, shared = np.diag([draw(SPREAD), draw(SPREAD)]), np.diag([draw(SPREAD), draw(SPREAD)])
    size = draw(st.one_of(st.just(0.5), WILD))
    label = draw(st.sampled_from(["chair", "couch"]))
    return Sighting(label, 0.9, place, own, shared, size, 0.9, 0.5, 1.0, 0, 0)


@settings(max_examples=25, suppress_health_check=[HealthCheck.too_slow])
@given(st.lists(st.tuples(motions(), st.lists(sightings(), max_size=4)), min_size=1, max_size=8))
def test_whatever_comes_pose_and_map_stay_finite_and_covariances_positive(frames):
    mapper = Mapper(closes_loops=True)
    for index, (motion, seen) in enumerate(frames):
        update = mapper.step(observed(index, seen, motion))
        assert np.isfinite(update.pose_map_base.vector()).all()
        assert np.isfinite(update.pose_covariance).all()
        scale = max(1e-12, float(np.abs(update.pose_covariance).max()))
        assert np.linalg.eigvalsh((update.pose_covariance + update.pose_covariance.T) / 2)[0] >= -1e-6 * scale
    for item in mapper.objects():
        assert np.isfinite(item.position_m).all()
        assert np.isfinite([item.width_m, item.height_m, item.confidence, item.first_seen_s, item.last_seen_s]).all()
        assert np.linalg.eigvalsh(item.covariance_m2)[0] > -1e-9


def test_a_motion_that_cannot_be_is_a_fault_and_the_pose_stays():
    mapper = Mapper()
    mapper.step(observed(0, [], Motion()))
    before = mapper.pose_map_base
    for motion in (SE2(math.nan, 0.0, 0.0), SE2(0.0, 1e9, 0.0)):
        assert mapper.step(observed(1, [], Motion(motion, np.eye(3)))).pose_map_base == before
    bent = np.diag([0.1, -0.1, 0.1])
    assert mapper.step(observed(2, [], Motion(SE2(1.0, 0.0, 0.0), bent))).pose_map_base == before
    mapper.step_blind(Motion(SE2(math.inf, 0.0, 0.0), np.eye(3)))
    assert mapper.step(observed(3, [], Motion())).pose_map_base == before
