"""How far a map can be trusted: what is counted decides, the gravest cause comes first, faults lead to the docs."""

import json
import re
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.results import COVARIANCE, POSES, results

from edgemap.geometry.map_object import MapObject
from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.errors import RunFolderError
from edgemap.runtime.frames.faults import Fault, FaultKind, read_fault
from edgemap.runtime.frames.frame import Frame
from edgemap.runtime.motion.health import PictureHealth
from edgemap.runtime.motion.odometry.protocol import MotionState
from edgemap.runtime.outputs.verdict.causes import CAUSE_OF, CAUSES
from edgemap.runtime.outputs.verdict.doubled import DoubledObjects
from edgemap.runtime.outputs.verdict.run_counts import RunCounts
from edgemap.runtime.outputs.verdict.verdict import LEVELS, explain, is_doubtful, verdict_of

CHAIR = MapObject("chair-1", "chair", np.array([1.0, 2.0]), np.diag([0.01, 0.01]), 0.5, 0.9, 40, 0.95, 0.0, 9.0)
QUALITY = {
    "frames": 600, "blind_frames": 3, "blind": {"blurred": 3}, "guessed_frames": 2, "still_frames": 0,
    "wheel_frames": 599, "gyro_frames": 0, "object_frames": 500, "carried_frames": 0, "mount_frames": 0,
    "travelled_m": 20.0, "sigma_m": {"end": 0.06, "largest": 0.2}, "heading_sigma_deg": {"end": 0.6, "largest": 2.0},
    "duration_s": 60.0, "rate_hz": 10.0,
}  # fmt: skip
RECORD = {
    "intrinsics": {"width": 640, "height": 480, "fx": 587.0, "fy": 587.0, "cx": 319.5, "cy": 239.5},
    "mount": {"height_m": 0.6, "pitch_deg": 11.5, "roll_deg": 0.0},
    "mount_seen": {"pitch_deg": 11.2, "roll_deg": 0.1, "sigma_pitch_deg": 0.4, "sigma_roll_deg": 0.4},
    "envelope": "",
    "faults": [],
}


def record(quality=None, **changed):
    return RECORD | {"quality": QUALITY | (quality or {})} | changed


def test_a_calm_drive_is_good_and_a_record_of_an_older_run_is_used_with_care():
    verdict = verdict_of(record(), [CHAIR])
    assert verdict.document() == {"level": "good", "reasons": []}
    assert verdict.line == "map: good"
    assert verdict_of({"faults": []}, [CHAIR]).level == "care"


def test_objects_that_stand_as_earlier_ones_do_but_elsewhere_show_a_wrong_start_or_pose():
    places = np.random.default_rng(1).uniform(0.0, 6.0, (8, 2))
    saved = [replace(CHAIR, id=f"chair-{n}", position_m=at, earlier=True) for n, at in enumerate(places)]
    new = [replace(CHAIR, id=f"chair-{n + 8}", position_m=SE2(2.0, 1.0, 1.5).apply(at)) for n, at in enumerate(places)]
    counts = RunCounts(dict(RECORD))
    for objects, twice in (([*saved, *new], 8), (saved, None), ([replace(one, earlier=False) for one in saved], None)):
        counts.objects = objects
        doubled = counts.quality()["doubled"]
        assert (doubled and doubled["objects"]) == twice
        assert ("8 objects stand twice" in verdict_of(record({"doubled": doubled}), objects).line) == bool(twice)
    compared = DoubledObjects()
    for vanished in (saved, saved[:3]):  # of which more are forgotten
        compared.ended()
        found = compared.seen(new, vanished)
        assert found
        assert found["objects"] == 8


def test_a_pose_that_a_person_sets_wrongly_shows_by_the_objects_that_stand_twice_since():
    frames = [Frame(i, float(i), np.zeros((48, 64, 3), np.uint8)) for i in range(8)]
    places = np.random.default_rng(1).uniform(0.0, 6.0, (7, 2))
    old = [replace(CHAIR, id=f"chair-{n}", position_m=at, last_seen_s=3.5) for n, at in enumerate(places)]
    elsewhere = SE2(2.0, 1.0, 1.5)
    new = [
        replace(CHAIR, id=f"chair-{n + 9}", position_m=elsewhere.apply(at), first_seen_s=4.0)
        for n, at in enumerate(places)
    ]
    for wrong in (True, False):
        counts = RunCounts(dict(RECORD))
        for result in results(frames, POSES[:8]):
            moves = wrong and result.frame.index >= 4
            pose = elsewhere @ result.pose_map_base if moves else result.pose_map_base
            counts.write(replace(result, pose_map_base=pose), [*old, *new][: 3 + 2 * result.frame.index])
        counts.objects = [*old, *new]
        counts.close()
        doubled = counts.quality()["doubled"]
        assert (doubled and doubled["objects"]) == (7 if wrong else None)


@pytest.mark.parametrize("measured", [{}, {"attitude_sources": {"depth": 400}}, {"odometry": "poses.tum"}])
def test_a_worktop_taken_for_floor_matters_only_where_the_floor_gives_lengths(measured):
    wheels = 0 if measured else 599
    assert verdict_of(record({"worktop_frames": 300, "wheel_frames": wheels}, **measured), [CHAIR]).findings == ()


def test_a_carried_camera_of_a_guessed_height_is_advised_to_measure_it():
    guess = {"focal_sigma_share": 0.04, "height_sigma_share": 0.15, "sigma_pitch_deg": 5.5, "sway_deg": 5.0}
    verdict = verdict_of(record({"wheel_frames": 0}, camera_guess=guess), [CHAIR])
    assert verdict.level == "unreliable"
    assert CAUSES["height_guess"] in [finding.cause for finding in verdict.findings]


PITCH = {"pitch_deg": 16.4, "roll_deg": 0.0, "sigma_pitch_deg": 0.4, "sigma_roll_deg": 0.4}
GUESS = {"focal_sigma_share": 0.18, "height_sigma_share": 0.08}
UP = {"height_m": 0.6, "roll_deg": 0.0}
HEIGHT = {"fault_kinds": {"mount_height": 1}, "mount_seen": {"height_m": 0.38, "sigma_height_m": 0.03}}
LISTED = {"faults": [{"kind": "mount_height", "frame": 90, "text": "mount: measure it again"}]}


@pytest.mark.parametrize(
    ("changed", "level", "cause", "words"),
    [
        ({"quality": {"blind_frames": 240, "blind": {"dark": 240}}}, "unreliable", "light", "40 % of the pictures"),
        ({"quality": {"blind_frames": 60, "blind": {"dark": 60}}}, "care", "light", "10 % of the pictures"),
        ({"quality": {"worktop_frames": 60, "wheel_frames": 0}}, "care", "worktop", "in 10 % of the pictures cups"),
        ({"quality": {"worktop_frames": 210, "wheel_frames": 0}}, "unreliable", "worktop", "lengths may be twice"),
        ({"quality": {"worktop_frames": 60, "still_frames": 400, "wheel_frames": 0}}, "unreliable", "worktop", "30 %"),
        ({"quality": {"sigma_m": {"end": 0.3}, "wheel_frames": 0, "carried_frames": 300}}, "care", "carried", "0.30 m"),
        ({"mount_seen": PITCH}, "unreliable", "mount", "pitch is 16.4 deg, not 11.5 deg"),
        ({"mount_seen": PITCH | {"used_pitch_deg": 16.3}}, "care", "mount", "corrected on the way"),
        (HEIGHT, "unreliable", "scale", "the lens is 0.38 m above the floor, not 0.60 m"),
        ({"fault_kinds": {"late": 2, "recovered": 2}}, "care", "device", "late 2, recovered 2"),
        ({"mount": UP | {"pitch_deg": -20.0}, "mount_seen": {}}, "unreliable", "floor", "nearest floor"),
        ({"mount": UP | {"pitch_deg": -30.0}, "mount_seen": {}}, "unreliable", "floor", "no floor is in view"),
        ({"quality": {"sigma_m": {"end": 0.3}, "wheel_frames": 0}}, "care", "wheels", "known to 0.30 m"),
        ({"quality": {"heading_sigma_deg": {"end": 33.0}, "wheel_frames": 0}}, "unreliable", "wheels", "33 deg"),
        ({"quality": {"heading_sigma_deg": {"end": 120.0}}}, "unreliable", "drift", "the heading is unknown"),
        ({"quality": {"wheel_frames": 300}}, "care", "wheels", "50 % of the frames in motion have no wheel odometry"),
        ({"quality": {"wheel_frames": 0, "wheels": True}}, "care", "wheels", "100 % of the frames in motion"),
        ({"quality": {"wheel_frames": 0, "camera_frames": 300}, "odometry": "wheel:w.csv"}, "care", "wheels",
         "50 % of the frames in motion have no wheel odometry"),
        ({"quality": {"wheel_frames": 0, "guessed_frames": 60}, "odometry": "wheel:w.csv"}, "care", "wheels",
         "10 % of the frames in motion"),
        ({"quality": {"guessed_frames": 200}}, "unreliable", "drift", "33 % of the frames is a guess"),
        ({"quality": {"rate_hz": 2.0}}, "care", "rate", "2.0 pictures per second"),
        ({"quality": {"carried_frames": 200}}, "care", "carried", "sways"),
        ({"camera_guess": GUESS | {"turned_by": "90 degrees clockwise", "sway_deg": 17.0}}, "unreliable", "turned",
         "turn them by 90 degrees clockwise"),
        ({"camera_guess": GUESS}, "care", "height_guess", "lens and mount are guessed (focal length to 18 %, height"),
        ({"camera_guess": GUESS | {"height_sigma_share": 0.2}}, "unreliable", "height_guess", "to 20 %"),
        ({"camera_guess": GUESS | {"height_sigma_share": 0.0}}, "care", "guess", "the lens is guessed (focal length"),
        ({"camera_guess": GUESS | {"focal_sigma_share": 0.0, "height_sigma_share": 0.0, "sigma_pitch_deg": 0.7}},
         "care", "guess", "the mount is guessed (pitch to 0.7 deg)"),
        ({"camera_guess": {"focal_sigma_share": 0.1, "height_sigma_share": 0.1, "sway_deg": 9.0},
          "mount_seen": {"pitch_deg": 55.8, "sigma_pitch_deg": 4.3}}, "unreliable", "carried", "sways by 9 deg"),
    ],
)  # fmt: skip
def test_each_finding_has_its_level_and_cause(changed, level, cause, words):
    verdict, steps = explain(record(**changed), [CHAIR])
    assert verdict.level == level
    assert steps[0].cause is CAUSES[cause]
    assert words in verdict.findings[0].text


def test_a_cause_comes_before_what_follows_from_it():
    """A wrong mount that was corrected ruins the pose: the pose is graver, and the mount is the reason."""
    quality = {"sigma_m": {"end": 3.7}, "heading_sigma_deg": {"end": 56.0}, "wheel_frames": 0}
    verdict, steps = explain(record(quality, mount_seen=PITCH | {"used_pitch_deg": 16.3}), [CHAIR])
    assert verdict.level == "unreliable"
    assert [step.cause for step in steps] == [CAUSES["mount"], CAUSES["wheels"]]


def test_wheels_beside_a_wrong_height_are_not_missing():
    verdict, (step, *_) = explain(record({"wheel_frames": 30}, **HEIGHT, **LISTED), [CHAIR])
    assert step.cause is CAUSES["scale"]
    without = "95 % of the frames in motion have no wheel odometry"
    assert step.evidence[-2:] == (without, "frame 90: mount: measure it again")
    assert {finding.cause for finding in verdict.findings} == {CAUSES["scale"]}


def test_faults_alone_come_last_and_change_nothing():
    faults = [{"kind": kind, "frame": 3, "text": "as it is"} for kind in ("blurred", "output", "edit")]
    verdict, steps = explain(record(faults=faults, fault_kinds={"blurred": 1, "output": 1, "edit": 1}), [CHAIR])
    assert verdict.level == "good"
    assert [(step.cause, step.counted) for step in steps] == [(CAUSES["light"], False), (CAUSES["output"], False)]


@given(st.lists(st.tuples(st.sampled_from(FaultKind), st.text(), st.text()), max_size=20))
def test_the_words_of_faults_change_no_verdict_and_no_cause(faults):
    counts = Counter(kind.value for kind, *_ in faults)
    answers = []
    for which in (0, 1):
        listed = [{"kind": kind.value, "frame": 1, "text": texts[which]} for kind, *texts in faults]
        verdict, steps = explain(record(faults=listed, fault_kinds=counts), [CHAIR])
        answers.append((verdict, [(step.cause, step.counted) for step in steps]))
    assert answers[0] == answers[1]


def test_what_the_map_holds_counts_too():
    weak = replace(CHAIR, id="chair-2", confidence=0.3)
    assert is_doubtful(weak)
    assert not is_doubtful(replace(weak, confirmed=True))
    assert verdict_of(record(), [CHAIR, CHAIR, weak]).level == "care"
    assert verdict_of(record(), [CHAIR, weak, weak]).level == "unreliable"
    assert verdict_of(record(), [replace(CHAIR, covariance_m2=np.diag([0.09, 0.09]))]).level == "care"
    assert verdict_of(record(), []).level == "unreliable"


@given(st.floats(0.0, 5.0), st.floats(0.0, 180.0), st.integers(0, 600), st.integers(0, 600), st.floats(0.0, 5.0))
def test_more_that_is_wrong_is_never_better(sigma_m, heading, blind, guessed, more_m):
    def level(sigma):
        quality = {"sigma_m": {"end": sigma}, "heading_sigma_deg": {"end": heading}}
        verdict = verdict_of(record(quality | {"blind_frames": blind, "guessed_frames": guessed}), [CHAIR])
        assert json.loads(json.dumps(verdict.document()))["level"] == verdict.level
        return LEVELS.index(verdict.level)

    assert level(sigma_m + more_m) >= level(sigma_m)


def test_every_kind_of_fault_has_one_cause_and_every_cause_a_section_of_the_docs():
    page = (Path(__file__).parents[2] / "docs" / "troubleshooting.md").read_text()
    anchors = {re.sub(r"[^a-z]+", "-", title.lower()).strip("-") for title in re.findall(r"^## (.+)$", page, re.M)}
    assert {cause.anchor for cause in CAUSES.values()} <= anchors
    # That a kind leads to two causes, or to none, shows as a wrong number.
    without = {FaultKind.EDIT, FaultKind.ENDED, FaultKind.OTHER}
    assert {kind for kind in FaultKind if CAUSE_OF.get(kind) is None} == without
    assert sum(len(cause.kinds) for cause in CAUSES.values()) == len(FaultKind) - len(without)


@pytest.mark.parametrize(
    ("entry", "fault"),
    [
        ("frame 3: an older line", Fault(FaultKind.OTHER, "frame 3: an older line")),
        ({"kind": "of a later version", "frame": 2, "text": "new"}, Fault(FaultKind.OTHER, "new", 2)),
        (Fault(FaultKind.DARK, "dark", 7).document(), Fault(FaultKind.DARK, "dark", 7)),
    ],
)
def test_faults_of_any_version_are_read(entry, fault):
    assert read_fault(entry) == fault


@pytest.mark.parametrize("changed", [{"sigma_m": 3}, {"frames": "many"}, {"blind_frames": None}, {"sigma_m": {}}])
def test_a_damaged_run_json_is_one_line(changed):
    with pytest.raises(RunFolderError, match=r"^run\.json: damaged, or of another version \(.+\)$"):
        explain(record(changed), [CHAIR])
    with pytest.raises(RunFolderError):
        explain(record(faults=3), [CHAIR])


def changed(result, **observed):
    return replace(result, observed=replace(result.observed, **observed))


def test_what_is_counted():
    given = list(results([Frame(i, 0.2 * i, np.zeros((48, 64, 3), np.uint8)) for i in range(10)], POSES[:10]))
    given[2] = changed(given[2], health=PictureHealth(Fault(FaultKind.DARK, "dark")))
    given[3] = changed(given[3], health=PictureHealth(Fault(FaultKind.REPEATED, "as before")), at_rest=True)
    motion = given[4].observed.motion
    given[4] = changed(given[4], motion=replace(motion, state=MotionState.BLIND))
    given[5] = changed(given[5], motion=replace(motion, members={"wheels": "used", "gyro": "left_out"}))
    counter = RunCounts({})
    for result in given:
        counter.write(result, [])
    found = counter.quality()
    assert (found["frames"], found["blind_frames"], found["blind"]) == (10, 1, {"dark": 1})
    assert (found["guessed_frames"], found["still_frames"]) == (1, 1)
    assert (found["wheel_frames"], found["gyro_frames"], found["object_frames"]) == (1, 0, 10)
    assert found["wheels"]
    assert found["rate_hz"] == pytest.approx(5.0)
    assert found["duration_s"] == pytest.approx(1.8)
    largest = np.sqrt(np.linalg.eigvalsh(COVARIANCE[:2, :2])[-1])
    assert found["sigma_m"] == {"end": pytest.approx(largest, abs=1e-4), "largest": pytest.approx(largest, abs=1e-4)}
    assert found["heading_sigma_deg"]["end"] == pytest.approx(np.degrees(np.sqrt(0.03)), abs=1e-3)
