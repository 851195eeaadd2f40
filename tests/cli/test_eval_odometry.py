"""`edgemap eval odometry` on drives of every layout, against errors that are known."""

import json
import math

import cv2
import numpy as np
import pytest
from support.pictures import noise
from support.refusal import one_line

from edgemap.geometry.camera.intrinsics import Intrinsics
from edgemap.geometry.camera.mount import Mount
from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.trajectory import Trajectory
from edgemap.runtime.inputs.drives import CameraFile, write_drive, write_locobot

COUNT = 61
LENS, MOUNT = Intrinsics(64, 48, 50.0, 50.0, 31.5, 23.5), Mount.from_degrees(0.5, 20.0)
LEVEL = "{width: 64, height: 48, fx: 50, fy: 50, cx: 31.5, cy: 23.5, fps: 10, mount: {height_m: 1.5, pitch_deg: 0}}"
WAY = tuple(SE2(0.1 * max(i - 10, 0), 0.0, 0.0) for i in range(COUNT))  # a second of standing, then 5 m ahead
STAMPS_S = np.arange(COUNT) / 10


def pictures(folder):
    folder.mkdir(parents=True)
    for index in range(COUNT):
        cv2.imwrite(str(folder / f"{index}.png"), noise(index, (48, 64, 3)))


def wheels(share):
    """Rows of wheel odometry that go too far by a share and creep 1 mm a frame at rest."""
    far_m = [(1 + share) * pose.x_m + 0.001 * min(i, 10) for i, pose in enumerate(WAY)]
    return [(stamp, x_m, 0.0, 0.0) for stamp, x_m in zip(STAMPS_S, far_m, strict=True)]


def drive(folder, share=0.05):
    pictures(folder / "images")
    write_drive(folder, CameraFile(LENS, MOUNT, 10.0), Trajectory(STAMPS_S, WAY), wheel=wheels(share))
    return f"drive:{folder}"


def kitti(folder):
    """5 m ahead on a slope of 0.1 rad: the world is the first camera's, z ahead and y down."""
    pictures(folder / "image")
    (folder / "camera.yaml").write_text(LEVEL)
    lines = [f"1 0 0 0 0 1 0 {-pose.x_m * math.sin(0.1)} 0 0 1 {pose.x_m * math.cos(0.1)}\n" for pose in WAY]
    (folder / "poses.txt").write_text("".join(lines))
    return f"kitti:{folder}"


def locobot(folder):
    pictures(folder / "rgb")
    write_locobot(folder, CameraFile(LENS, MOUNT, 10.0), wheels(0.05), Trajectory(STAMPS_S, WAY))
    return f"locobot:{folder}"


@pytest.fixture
def evaluate(edgemap, painted_bundle):
    def run(*arguments):
        return edgemap("eval", "odometry", "--bundle", painted_bundle, *arguments)

    return run


def document(result):
    assert result.returncode == 0, result.stderr
    return json.loads(result.stdout)


def test_wheels_that_go_too_far_are_found_out(evaluate, tmp_path):
    specs = drive(tmp_path / "a", 0.05), drive(tmp_path / "b", 0.10), locobot(tmp_path / "c")
    words = "--data", *specs[:2], "--data", specs[2], "--odometry", "wheel", "--segments", "0.95,9", "--json"
    found = document(evaluate(*words))
    assert list(found["sequences"]) == ["a", "b", "c"]
    a, b = found["sequences"]["a"], found["sequences"]["b"]
    assert (a["data"], a["frames"], a["mount"]) == (specs[0], COUNT, {"height_m": 0.5, "pitch_deg": 20.0})
    assert a["path_m"] == pytest.approx(5.0)
    # Segments of 0.95 m end 1.0 m on; the one that starts at rest holds the 1 cm of creep as well. They start at frames
    # 0, 10, 20, 30, 40 and 50.
    assert a["t_rel_percent"] == {"0.95": pytest.approx(100 * (5 * 0.05 + 0.06) / 6 / 0.95, rel=1e-3), "9": None}
    assert found["sequences"]["c"]["t_rel_percent"] == pytest.approx(a["t_rel_percent"], nan_ok=True)
    assert a["still"]["frames"] == 10
    assert a["still"]["cm_per_frame"] == {"mean": pytest.approx(0.1, rel=1e-3), "max": pytest.approx(0.1, rel=1e-3)}
    assert b["rmse_forward_m"] == pytest.approx(math.sqrt((50 * 0.01**2 + 10 * 0.001**2) / 60), rel=1e-3)
    total = found["total"]
    assert total["segments"] == {"0.95": 18, "9": 0}
    assert total["worst"]["sequence"] == "b"
    assert total["path_m"] == pytest.approx(15.0)


def test_frames_are_chosen_and_their_rate_is_told(evaluate, tmp_path):
    spec = drive(tmp_path / "a")
    flags = ("--data", spec, "--odometry", "wheel", "--from", "10", "--every", "2", "--frames", "11", "--json")
    own = document(evaluate(*flags))["sequences"]["a"]
    assert (own["frames"], own["rate_hz"]) == (11, 5.0)
    assert own["path_m"] == pytest.approx(2.0)
    assert own["rmse_forward_m"] == pytest.approx(0.01, rel=1e-3)
    assert own["t_rel_percent"] == {"1": pytest.approx(6.0, rel=1e-3), "2": None, "5": None}  # ends 1.2 m on


def test_kitti_has_its_own_lengths_and_tells_what_three_values_leave_out(evaluate, tmp_path):
    own = document(evaluate("--data", kitti(tmp_path / "k"), "--odometry", "truth", "--json"))["sequences"]["k"]
    assert list(own["t_rel_percent"]) == [str(length) for length in range(100, 900, 100)]
    assert own["ate_m"] == pytest.approx(0.0, abs=1e-9)
    assert own["planar_fit"]["max_m"] == pytest.approx(0.0, abs=1e-6)  # the nose is level, only the height is lost
    assert own["planar_fit"]["height_max_m"] == pytest.approx(5 * math.sin(0.1))
    assert own["planar_fit"]["t_rel_percent"] is None


def test_a_file_of_poses_gives_the_attitude_as_in_a_run(evaluate, tmp_path):
    half, none = 0.02 * np.sin(STAMPS_S), np.zeros(COUNT)
    poses = np.array([STAMPS_S, [pose.x_m for pose in WAY], none, none, none, np.sin(half), none, np.cos(half)]).T
    np.savetxt(tmp_path / "poses.tum", poses)
    found = document(evaluate("--data", drive(tmp_path / "a"), "--odometry", tmp_path / "poses.tum", "--json"))
    assert found["sequences"]["a"]["attitude"]["sources"] == {"poses": 1.0}


def test_people_get_lines_and_a_picture(evaluate, tmp_path):
    pytest.importorskip("matplotlib")
    specs = drive(tmp_path / "one" / "a"), drive(tmp_path / "two" / "a", 0.1)
    result = evaluate("--data", *specs, "--odometry", "wheel", "--plot", tmp_path / "plots")
    assert result.returncode == 0, result.stderr
    lines = result.stdout.splitlines()
    assert lines[1] == f"{specs[0]}: 61 frames at 10 Hz, 5.0 m, camera 0.50 m high, 20.0 deg down"
    assert "no segment of 5 m fits" in lines[2]
    assert any(line.startswith("total: 2 sequences, 122 frames, 10.0 m") for line in lines)
    drawn = sorted((tmp_path / "plots").iterdir())
    assert len(drawn) == 2
    assert all(cv2.imread(str(path)) is not None for path in drawn)


def test_tuned_numbers_can_be_given(evaluate, tmp_path):
    (tmp_path / "few.yaml").write_text("config:\n  odometry:\n    pictures: {corners: {corners: 60}}\n")
    flags = ("--frames", "40", "--without-wheels", "--json")
    found, few = (document(evaluate(*flags, *more)) for more in ((), ("--config", tmp_path / "few.yaml")))
    assert found["sequences"]["demo"]["ate_m"] != few["sequences"]["demo"]["ate_m"]


def test_a_mount_can_be_given_where_the_data_have_none_or_another(evaluate, tmp_path):
    spec = kitti(tmp_path / "k")
    flags = ("--data", spec, "--mount", "0.7,4", "--odometry", "truth", "--json")
    assert document(evaluate(*flags))["sequences"]["k"]["mount"] == {"height_m": 0.7, "pitch_deg": 4.0}
    (tmp_path / "k" / "camera.yaml").write_text(LEVEL.replace(", mount: {height_m: 1.5, pitch_deg: 0}", ""))
    assert document(evaluate(*flags))["sequences"]["k"]["mount"] == {"height_m": 0.7, "pitch_deg": 4.0}
    assert "or give --mount" in one_line(evaluate("--data", spec))


def test_what_cannot_be_done_is_one_line(evaluate, tmp_path):
    assert "no wheel odometry" in one_line(evaluate("--data", kitti(tmp_path / "k"), "--odometry", "wheel"))
    (tmp_path / "k" / "camera.yaml").unlink()
    assert "lens unknown: write it into its camera.yaml" in one_line(evaluate("--data", f"kitti:{tmp_path / 'k'}"))
    pictures(tmp_path / "p")
    assert "brings no true poses" in one_line(evaluate("--camera", tmp_path / "p"))
