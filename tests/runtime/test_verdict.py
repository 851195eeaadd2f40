"""How far a map can be trusted: what was counted decides, the gravest cause comes first, faults lead to the docs."""

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from edgemap.geometry.map_object import MapObject
from edgemap.runtime.frames.errors import RunFolderError
from edgemap.runtime.outputs.verdict.causes import CAUSES, cause_of_fault
from edgemap.runtime.outputs.verdict.explain import explain
from edgemap.runtime.outputs.verdict.verdict import LEVELS, is_doubtful, verdict_of

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


def test_a_calm_drive_is_good():
    verdict = verdict_of(record(), [CHAIR])
    assert verdict.document() == {"level": "good", "reasons": []}
    assert verdict.line == "map: good"


@pytest.mark.parametrize("measured", [{}, {"attitude_sources": {"depth": 400}}, {"odometry": "poses.tum"}])
def test_a_worktop_taken_for_floor_matters_only_where_the_floor_gives_lengths(measured):
    wheels = 0 if measured else 599
    assert verdict_of(record({"worktop_frames": 300, "wheel_frames": wheels}, **measured), [CHAIR]).findings == ()


def test_pictures_on_their_side_are_the_first_thing_to_mend():
    guess = GUESS | {"turned_by": "90 degrees clockwise", "sway_deg": 17.0}
    verdict = verdict_of(record(camera_guess=guess), [CHAIR])
    assert verdict.level == "unreliable"
    assert verdict.findings[0].cause is CAUSES["turned"]
    assert "turn them by 90 degrees clockwise" in verdict.line


def test_a_carried_camera_of_a_guessed_height_is_advised_to_measure_it():
    guess = {"focal_sigma_share": 0.04, "height_sigma_share": 0.15, "sigma_pitch_deg": 5.5, "sway_deg": 5.0}
    verdict = verdict_of(record({"wheel_frames": 0}, camera_guess=guess), [CHAIR])
    assert verdict.level == "unreliable"
    assert CAUSES["height_guess"] in [finding.cause for finding in verdict.findings]


PITCH = {"pitch_deg": 16.4, "roll_deg": 0.0, "sigma_pitch_deg": 0.4, "sigma_roll_deg": 0.4}
GUESS = {"focal_sigma_share": 0.18, "height_sigma_share": 0.08}
UP = {"height_m": 0.6, "roll_deg": 0.0}
HEIGHT = [
    "frame 90: mount: height 0.60 m given, the usual height of chair would make it 0.38 m, to 9 %: measure it again"
]


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
        ({"faults": HEIGHT}, "unreliable", "scale", "would make it 0.38 m"),
        ({"mount": UP | {"pitch_deg": -20.0}, "mount_seen": {}}, "unreliable", "floor", "nearest floor"),
        ({"mount": UP | {"pitch_deg": -30.0}, "mount_seen": {}}, "unreliable", "floor", "no floor is in view"),
        ({"quality": {"sigma_m": {"end": 0.3}, "wheel_frames": 0}}, "care", "wheels", "known to 0.30 m"),
        ({"quality": {"heading_sigma_deg": {"end": 33.0}, "wheel_frames": 0}}, "unreliable", "wheels", "33 deg"),
        ({"quality": {"heading_sigma_deg": {"end": 120.0}}}, "unreliable", "drift", "the heading is unknown"),
        ({"quality": {"wheel_frames": 300}}, "care", "wheels", "50 % of the frames in motion have no wheel odometry"),
        ({"quality": {"wheel_frames": 0, "wheels": True}}, "care", "wheels", "100 % of the frames in motion"),
        ({"quality": {"wheel_frames": 0, "guessed_frames": 60}, "odometry": "wheel:w.csv"}, "care", "wheels",
         "10 % of the frames in motion"),
        ({"quality": {"guessed_frames": 200}}, "unreliable", "drift", "33 % of the frames is a guess"),
        ({"quality": {"rate_hz": 2.0}}, "care", "rate", "2.0 pictures per second"),
        ({"quality": {"carried_frames": 200}}, "care", "carried", "sways"),
        ({"camera_guess": GUESS}, "care", "height_guess", "lens and mount are guessed (focal length to 18 %, height"),
        ({"camera_guess": GUESS | {"height_sigma_share": 0.2}}, "unreliable", "height_guess", "to 20 %"),
        ({"camera_guess": GUESS | {"height_sigma_share": 0.0}}, "care", "guess", "the lens is guessed (focal length"),
        ({"camera_guess": GUESS | {"focal_sigma_share": 0.0, "height_sigma_share": 0.0, "sigma_pitch_deg": 0.7}},
         "care", "guess", "the mount is guessed (pitch to 0.7 deg)"),
        ({"camera_guess": {"focal_sigma_share": 0.1, "height_sigma_share": 0.1, "sway_deg": 9.0},
          "mount_seen": {"pitch_deg": 55.8, "sigma_pitch_deg": 4.3}}, "unreliable", "carried", "sways by 9 deg"),
        ({"envelope": "flow odometry: the camera is outside"}, "care", "camera", "the camera is outside"),
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
    verdict, (step, *_) = explain(record({"wheel_frames": 30}, faults=HEIGHT), [CHAIR])
    assert step.cause is CAUSES["scale"]
    assert step.evidence[-2:] == ("95 % of the frames in motion have no wheel odometry", *HEIGHT)
    assert {finding.cause for finding in verdict.findings} == {CAUSES["scale"]}


def test_faults_alone_come_last_and_change_nothing():
    faults = ["frame 3: blind: picture blurred (sharpness 0.2)", "frame 9: a.mcap: No space left; the run goes on"]
    verdict, steps = explain(record(faults=faults), [CHAIR])
    assert verdict.level == "good"
    assert [(step.cause, step.counted) for step in steps] == [(CAUSES["light"], False), (CAUSES["output"], False)]


def test_a_fault_that_is_a_finding_stands_there_once():
    finding = verdict_of(record(faults=HEIGHT), [CHAIR]).findings[0].text
    assert HEIGHT[0].endswith(finding)
    assert explain(record(faults=HEIGHT), [CHAIR])[1][0].evidence == tuple(HEIGHT)


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
        quality = {
            "sigma_m": {"end": sigma},
            "heading_sigma_deg": {"end": heading},
            "blind_frames": blind,
            "guessed_frames": guessed,
        }
        verdict = verdict_of(record(quality), [CHAIR])
        assert json.loads(json.dumps(verdict.document()))["level"] == verdict.level
        return LEVELS.index(verdict.level)

    assert level(sigma_m + more_m) >= level(sigma_m)


def test_every_cause_leads_to_a_section_of_the_docs():
    page = (Path(__file__).parents[2] / "docs" / "troubleshooting.md").read_text()
    anchors = {re.sub(r"[^a-z]+", "-", title.lower()).strip("-") for title in re.findall(r"^## (.+)$", page, re.M)}
    assert {cause.anchor for cause in CAUSES.values()} <= anchors


@pytest.mark.parametrize(
    ("fault", "cause"),
    [
        ("frame 1: blind: picture dark (brightest 3 grey levels)", "light"),
        ("mount: pitch 16.5 and roll 0.0 deg given, the room's edges give pitch 11.6", "mount"),
        ("mount: height 0.40 m given, the wheels would make it 0.61 m, to 4 %: measure it again", "scale"),
        ("mount: height 0.40 m given, the floor in depth pictures gives 0.61 m: measure it again", "scale"),
        ("wheels: its turn is 12 % of what the camera measures: left out", "wheels"),
        ("odometry wheel:w.csv: no sample from 3.1 to 3.2 s", "wheels"),
        ("delivers again after 3.2 s (opened 1 times, USB reset 0 times)", "device"),
        ("a.json: cannot be written (No space left on device); the run goes on", "output"),
    ],
)
def test_a_fault_leads_to_its_cause(fault, cause):
    assert cause_of_fault(fault) is CAUSES[cause]


def test_a_record_of_an_older_run_is_used_with_care():
    assert verdict_of({"faults": []}, [CHAIR]).level == "care"


@pytest.mark.parametrize("changed", [{"sigma_m": 3}, {"frames": "many"}, {"blind_frames": None}, {"sigma_m": {}}])
def test_a_damaged_run_json_is_one_line(changed):
    with pytest.raises(RunFolderError, match=r"^run\.json: damaged, or of another version \(.+\)$"):
        explain(record(changed), [CHAIR])
    with pytest.raises(RunFolderError):
        explain(record(faults=3), [CHAIR])
