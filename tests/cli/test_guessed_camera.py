"""`run` with pictures that nobody has calibrated, as a new user types it."""

import json
import math
import shlex
from dataclasses import replace

import cv2
import numpy as np
import pytest
from support.depth_room import depth_room, record_depth

from edgemap.calibrate.first_pictures import guessing_frames
from edgemap.cli import main
from edgemap.cli.groups import Source
from edgemap.cli.guessed_camera import CameraKeeper
from edgemap.geometry.camera.floor import FloorCamera
from edgemap.geometry.camera.intrinsics import Intrinsics
from edgemap.geometry.camera.mount import HeightEstimate, Mount
from edgemap.geometry.odometry.rolling import Rolling
from edgemap.runtime.frames.errors import CameraError
from edgemap.runtime.inputs.drives.camera_yaml import read_camera_yaml
from edgemap.runtime.motion.camera_guess import CameraGuess


def test_without_camera_yaml_a_guess_asks_for_the_height_alone(edgemap, painted_bundle, pictures, tmp_path):
    """The commands that it prints run as they stand, in a folder with spaces too, and with another height. Lens and
    pitch remain guesses, so no map is called good."""
    (pictures / "camera.yaml").unlink()
    out, run = tmp_path / "first floor", ("run", "--camera", pictures, "--bundle", painted_bundle)
    done = edgemap.ok(*run, "--out", out)
    lines = done.stdout.splitlines()
    asked = lines.index(next(line for line in lines if "does not say its lens and mount: guessing" in line))
    assert lines[asked + 1] == "guessed from 12 pictures:"
    assert "focal length 51 +- 22 % px (usual field of view)" in done.stdout  # 0.8 of 64 px
    record = json.loads((out / "run.json").read_text())
    assert record["camera_guess"]["focal_sigma_share"] == 0.22
    assert any("guessed" in reason for reason in record["verdict"]["reasons"])
    kept = read_camera_yaml(out / "camera.yaml")
    assert abs(kept.mount.height_m - record["mount"]["height_m"]) < 1e-6

    def printed(start):
        (line,) = (line for line in lines if line.startswith(start))
        return shlex.split(line.replace(" HEIGHT_M", " 0.83"))[1:]

    (why,) = (line.partition("see ")[2] for line in lines if "see edgemap why" in line)
    assert edgemap(*shlex.split(why)[1:]).returncode == 0
    edgemap.ok(*printed("  edgemap map scale "))
    assert (tmp_path / "first floor-scaled" / "map.json").is_file()
    (more,) = (line.partition("the next run: ")[2][:-1] for line in lines if "the next run: -" in line)
    again = edgemap.ok(*run, *shlex.split(more), "--out", tmp_path / "again")
    assert "guessed from" not in again.stdout  # not once more, and still a guess
    command = printed("  edgemap run ")
    assert command[-2:] == ["--mount", "0.83"]  # no guess looks like a measurement
    measured = edgemap.ok(*command, "--bundle", painted_bundle, "--out", tmp_path / "measured")
    assert "  edgemap run " not in measured.stdout
    assert "height 0.83 m guessed" not in measured.stdout
    records = [json.loads((tmp_path / name / "run.json").read_text()) for name in ("again", "measured")]
    assert [one["verdict"]["level"] == "good" for one in (record, *records)] == [False] * 3
    guesses = [one["camera_guess"] for one in records]
    assert guesses[1]["height_sigma_share"] == 0.0 < guesses[0]["height_sigma_share"]
    assert guesses[1]["focal_sigma_share"] == record["camera_guess"]["focal_sigma_share"]
    assert records[1]["mount"]["height_m"] == 0.83
    assert read_camera_yaml(tmp_path / "measured" / "camera.yaml").mount.height_m == 0.83


def test_a_run_that_does_not_reach_its_end_keeps_its_guess(edgemap, painted_bundle, pictures, tmp_path):
    """As after a kill, a second Ctrl-C, or a camera that is lost for good."""
    (pictures / "camera.yaml").unlink()
    (pictures / "7.png").write_bytes(b"no picture")
    (tmp_path / "strict.yaml").write_text("config: {camera: {strict: true}}")
    strict = ("--config", tmp_path / "strict.yaml", "--bundle", painted_bundle, "--out", tmp_path / "run")
    done = edgemap("run", "--camera", pictures, *strict)
    assert done.returncode == 1
    record = json.loads((tmp_path / "run" / "run.json").read_text())
    assert 0 < record["frames"] < 12
    kept = read_camera_yaml(tmp_path / "run" / "camera.yaml")
    assert abs(kept.mount.height_m - record["mount"]["height_m"]) < 1e-6


def test_a_recording_of_a_run_by_a_guess_is_one_still(edgemap, painted_bundle, pictures, tmp_path):
    pytest.importorskip("mcap_ros2", reason="no mcap here (extra record)")
    (pictures / "camera.yaml").unlink()
    run = ("run", "--bundle", painted_bundle)
    edgemap.ok(*run, "--camera", pictures, "--record", tmp_path / "a.mcap", "--out", tmp_path / "run")
    for name, given in (("replay", ()), ("tape", ("--mount", "0.83"))):
        edgemap.ok(*run, "--camera", tmp_path / "a.mcap", *given, "--out", tmp_path / name)
        record = json.loads((tmp_path / name / "run.json").read_text())
        assert record["verdict"]["level"] != "good"
        assert (record["camera_guess"]["height_sigma_share"] == 0.0) == (name == "tape")
        assert record["camera_guess"]["focal_sigma_share"] > 0.0


@pytest.mark.parametrize(("odometry", "corrected"), [("hybrid", True), ("wheel:wheels.csv", False), ("truth", False)])
def test_lengths_that_poses_measure_stay(painted_bundle, pictures, tmp_path, monkeypatch, capsys, odometry, corrected):
    """With wheels or poses alone nothing of a motion is in proportion to a guessed height."""
    (pictures / "camera.yaml").unlink()
    monkeypatch.chdir(tmp_path)
    (tmp_path / "wheels.csv").write_text("stamp_s,x_m,y_m,yaw_rad\n0.0,0.0,0.0,0.0\n5.0,1.0,0.0,0.0\n")

    def built(*arguments):
        raise CameraError(f"guessed to {arguments[3].guessed_height:.3f}")

    monkeypatch.setattr("edgemap.runtime.compose.build_slam", built)
    words = ("run", "--camera", pictures, "--bundle", painted_bundle, "--odometry", odometry, "--out", tmp_path / "run")
    with pytest.raises(SystemExit):
        main([str(word) for word in words])
    (line,) = (line for line in capsys.readouterr().err.splitlines() if "guessed to" in line)
    assert line.endswith("guessed to 0.000") != corrected


def test_what_was_calibrated_since_is_no_guess():
    lens, mount = Intrinsics(640, 480, 587.0, 587.0, 319.5, 239.5), Mount(0.6, 0.2)
    guess = {"method": "guessed", "focal_sigma_share": 0.02, "height_sigma_share": 0.09, "sigma_pitch_deg": 0.5}

    def read(**more):
        found = CameraGuess.of_record(guess | more, lens, mount, "camera.yaml")
        return found and (found.focal_sigma, found.height_sigma, round(math.degrees(found.pitch_sigma_rad), 9))

    assert read() == (0.02, 0.09, 0.5)
    assert read(intrinsics={}) == (0.0, 0.09, 0.5)
    assert read(mount="by hand") == (0.02, 0.0, 0.0)
    assert read(tilt={}) == (0.02, 0.09, 0.0)
    assert read(intrinsics={}, mount={}) is None
    assert CameraGuess.of_record({"method": "chessboard"}, lens, mount, "camera.yaml") is None
    with pytest.raises(CameraError, match=r"camera.yaml: calibration"):
        read(height_sigma_share="high")


@pytest.mark.parametrize(
    ("record", "source", "seen", "said"),
    [
        (  # carried by a person
            {"height_sigma_share": 0.15, "sigma_pitch_deg": 5.5, "sway_deg": 5.0}, "walk.mp4",
            HeightEstimate(0.5, 0.04),
            ("as people carry a camera it is 0.60 m, to 15 %", "from floor to lens as you carry it",
             "--camera walk.mp4 --camera-file"),
        ),
        (  # no object has shown it
            {"focal_sigma_share": 0.22, "height_sigma_share": 1.0, "sigma_pitch_deg": 9.3}, "walk.mp4", None,
            ("no object of a usual size was seen; 0.60 m is usual for a robot",),
        ),
        ({"height_sigma_share": 0.09}, "rtsp://user:s3cret@10.0.0.2/live", None,
         ("rtsp://***@10.0.0.2/live", "by the sizes of objects")),
    ],
)  # fmt: skip
def test_the_height_is_asked_for_by_what_is_known_of_it(tmp_path, record, source, seen, said):
    floor = FloorCamera(Intrinsics(640, 480, 587.0, 587.0, 319.5, 239.5), Mount(0.6, 0.2))
    record = {"method": "guessed"} | record
    guess = CameraGuess.of_record(record, floor.intrinsics, floor.mount, "camera.yaml")
    text = CameraKeeper(tmp_path, floor, guess, source).at_end(None, seen)
    assert [one for one in said if one not in text] == []
    assert "--mount HEIGHT_M" in text
    assert "s3cret" not in text
    assert ("by the sizes of objects" in text) == ("by the sizes of objects" in said)


def test_a_depth_camera_measures_its_mount(edgemap, painted_bundle, tmp_path):
    """A RealSense recording without --mount: nothing is guessed, unless its depth is left out."""
    pytest.importorskip("pyrealsense2")
    mount = Mount.from_degrees(0.62, 19.0, 9.0)
    path = record_depth(tmp_path / "depth.db3", [depth_room(mount)] * 8)
    run = ("run", "--camera", f"realsense:{path}", "--bundle", painted_bundle, "--out")
    edgemap.ok(*run, tmp_path / "run")
    record = json.loads((tmp_path / "run" / "run.json").read_text())
    assert "camera_guess" not in record
    assert record["mount"]["height_m"] == pytest.approx(0.62, abs=0.01)
    assert record["mount"]["pitch_deg"] == pytest.approx(19.0, abs=0.3)
    assert record["mount"]["roll_deg"] == pytest.approx(9.0, abs=0.3)
    assert "guessing" in edgemap(*run, tmp_path / "without", "--without-depth").stdout


def test_a_folder_that_begins_at_rest_is_guessed_from_its_views(tmp_path):
    """70 pictures at rest and 10 others: every second of the latter by an even choice, all of them by views."""
    rng = np.random.default_rng(0)
    views = [cv2.resize(rng.integers(0, 255, (12, 16, 3), dtype=np.uint8), (320, 240)) for _ in range(11)]
    for index, view in enumerate([views[0]] * 70 + views[1:]):
        cv2.imwrite(str(tmp_path / f"{index:03d}.png"), view)
    camera = Source(camera=str(tmp_path))
    with camera.open() as source:
        assert [frame.index for frame in guessing_frames(source, camera.open)] == [0, *range(70, 80)]


@pytest.mark.parametrize(
    ("given", "lacking", "expected"),
    [
        (("--mount", "1.0,0"), "lens", {"height_m": 1.0, "pitch_deg": 0.0}),
        (("--intrinsics", "50,50,31.5,31.5"), "mount", {"fx": 50.0, "cy": 31.5}),
        (("--intrinsics", "50,50,31.5,31.5", "--mount", "0.83"), "pitch", {"fx": 50.0, "height_m": 0.83}),
    ],
)
def test_what_is_given_is_not_guessed(edgemap, painted_bundle, pictures, tmp_path, given, lacking, expected):
    (pictures / "camera.yaml").unlink()
    done = edgemap.ok("run", "--camera", pictures, "--bundle", painted_bundle, "--out", tmp_path / "run", *given)
    assert f"does not say its {lacking}: guessing from its first pictures\nguessed from 12 pictures:\n" in done.stdout
    record = json.loads((tmp_path / "run" / "run.json").read_text())
    known = record["mount"] | record["intrinsics"]
    assert {name: known[name] for name in expected} == expected
    if lacking == "pitch":
        assert "lens 0.83 m above the floor (as given)" in done.stdout
        assert record["camera_guess"]["focal_sigma_share"] == record["camera_guess"]["height_sigma_share"] == 0.0
        assert any("the mount is guessed (pitch to" in reason for reason in record["verdict"]["reasons"])
        assert "the pitch is missing" in edgemap("bench", "--camera", pictures, *given).stderr


def test_the_camera_file_of_a_guess_holds_what_the_drive_has_shown(tmp_path):
    """Height by sizes with its standard deviation, the lens before the turn axis; a known lever arm stays."""
    lens, mount = Intrinsics(640, 480, 587.0, 587.0, 319.5, 239.5), Mount(0.6, 0.2)
    record = {"method": "guessed", "focal_sigma_share": 0.02, "height_sigma_share": 0.3, "sigma_pitch_deg": 0.5}
    seen, turned = HeightEstimate(0.5, 0.04), Rolling(0.01, 0.23, 0.01)
    for arm_m, forward_m in ((0.0, 0.23), (0.1, 0.1)):
        floor, folder = FloorCamera(lens, replace(mount, forward_m=arm_m)), tmp_path / str(arm_m)
        folder.mkdir()
        guess = CameraGuess.of_record(record, lens, floor.mount, "camera.yaml")
        text = CameraKeeper(folder, floor, guess).at_end(None, seen, turned)
        kept = read_camera_yaml(folder / "camera.yaml")
        assert (kept.mount.height_m, kept.mount.forward_m) == (0.5, forward_m)
        assert kept.calibration["height_sigma_share"] == 0.08
        assert "by the sizes of objects it is 0.50 m, to 8 %, and the scale of the map" in text
        assert ("0.23 +- 0.01 m before the turn axis" in text) == (arm_m == 0.0)
    behind = CameraKeeper(tmp_path, FloorCamera(lens, mount), guess).at_end(None, seen, Rolling(0.01, -0.08, 0.01))
    assert "the lens is 0.08 +- 0.01 m behind the turn axis" in behind
    with_wheels = CameraKeeper(tmp_path, FloorCamera(lens, mount), guess).at_end(None, seen, turned, alone=False)
    assert "turn axis" not in with_wheels
