"""Every layout read from files that the tests write; poses of any world as a way on the floor."""

import json
import math
from functools import partial

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from support.pictures import write_pictures
from support.refusal import refused

from edgemap.geometry.camera.intrinsics import Intrinsics
from edgemap.geometry.camera.mount import Mount, Platform
from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.errors import CameraError
from edgemap.runtime.frames.spatial_poses import planarise, up_vector, upright_camera
from edgemap.runtime.frames.trajectory import Trajectory
from edgemap.runtime.inputs.drives import CameraFile, open_drive, write_drive, write_locobot

LENS, MOUNT = Intrinsics(64, 48, 58.0, 58.0, 31.5, 23.5), Mount.from_degrees(0.6, 11.5)
POSE_12, POSE = "1 0 0 0 0 1 0 0 0 0 1 0\n", "1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1\n"
THREE = {f"image/{number}.png": "" for number in range(3)}


def kitti(folder):
    write_pictures(folder / "image", 3)
    (folder / "poses.txt").write_text(3 * POSE_12)
    return f"kitti:{folder}"


def own(folder, count=3, **extra):
    write_pictures(folder / "images", count)
    poses = tuple(SE2(1.0, 2.0 + 0.5 * i, math.pi / 2) for i in range(count))
    write_drive(folder, CameraFile(LENS, MOUNT, 10.0), Trajectory(7.0 + np.arange(count) / 10, poses), **extra)
    return f"drive:{folder}"


refusal = partial(refused, CameraError, open_drive)


def test_kitti_without_a_camera_file_and_with_a_cars_mount_and_times(tmp_path):
    spec = kitti(tmp_path / "k")
    drive = open_drive(spec)
    assert (drive.intrinsics, drive.mount) == (None, None)
    np.testing.assert_allclose(drive.stamps_s, [0.0, 0.1, 0.2])
    lens = "width: 8, height: 6, fx: 5.0, fy: 5.0, cx: 3.5, cy: 2.5"
    (tmp_path / "k" / "camera.yaml").write_text(f"{{{lens}, mount: {{height_m: 1.65, pitch_deg: 0.0}}}}")
    (tmp_path / "k" / "times.txt").write_text("0.0\n1.04e-01\n2.07e-01\n")
    drive = open_drive(spec)
    assert drive.mount == Mount(1.65, platform=Platform.CAR)
    np.testing.assert_allclose(drive.stamps_s, [0.0, 0.104, 0.207])


EUROC_CAMERA = (
    "T_BS: {data: [1.0, 0, 0, 0, 0, 1.0, 0, 0, 0, 0, 1.0, 0, 0, 0, 0, 1.0]}\n"
    "resolution: [64, 48]\nintrinsics: [FX, 60.0, 32.0, 24.0]\n"
)


def folder_of(tmp_path, files):
    """files: text by relative path; a name that ends with .png gets a picture."""
    for name, text in files.items():
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        if name.endswith(".png"):
            cv2.imwrite(str(path), np.zeros((48, 64, 3), np.uint8))
        else:
            path.write_text(text)
    return tmp_path


LENS_FILE = {"camera.yaml": "{width: 64, height: 48, fx: 60, fy: 60, cx: 32, cy: 24}"}


def euroc(stamp="1000000000", fx="60.0", truth="1000000000 0 0 0 0 0 0 1\n"):
    camera = EUROC_CAMERA.replace("FX", fx)
    return {f"image/{stamp}.png": "", "cam0.yaml": camera, "imu.csv": "1000000000,0,0,0,0,0,9.8\n", "truth.txt": truth}


@pytest.mark.parametrize(
    ("kind", "files", "words"),
    [
        ("kitti", THREE | {"poses.txt": 2 * POSE_12}, "poses.txt: 2 lines for the 3 pictures in"),
        ("kitti", THREE | {"poses.txt": 3 * POSE_12.replace("0", "nan", 1)}, "poses.txt:1: xy is nan, must be"),
        ("kitti", THREE | {"poses.txt": 3 * "1 2 3\n"}, "poses.txt:1: '1 2 3', expected 12 finite numbers a line"),
        ("kitti", THREE | {"poses.txt": 3 * "a b c\n"}, "poses.txt:1: 'a b c', expected 12 finite numbers a line"),
        ("kitti", THREE | {"poses.txt": 3 * POSE_12.replace("1", "2")}, "pose 0 is no rigid motion"),
        ("kitti", THREE | {"poses.txt": "\n\n\n"}, "poses.txt: no rows of numbers in it"),
        ("c2w", {"a.png": "", "b.png": "", "poses.txt": 2 * POSE, "depth/a.png": ""}, "1 lines for the 2 pictures"),
        ("c2w", {"a.png": "", "poses.txt": POSE, "K.txt": "1 2 3"}, "3 numbers, expected a 3x3 matrix"),
        ("c2w", {"a.png": "", "poses.txt": POSE, "K.txt": "60 0 x 0 60 24 0 0 1"}, "not numbers, expected a 3x3"),
        ("c2w", {"a.png": "", "poses.txt": POSE, "K.txt": "-60 0 32 0 60 24 0 0 1"}, "fx is -60"),
        ("euroc", euroc(stamp="first"), "named after its stamp in nanoseconds"),
        ("euroc", euroc(fx="-1.0"), "fx is -1"),
        ("euroc", euroc(truth="9000000000 0 0 0 0 0 0 1\n"), "no picture lies in it"),
        ("tum", {"rgb.txt": "# nothing\n"}, "no rows of numbers in it"),
        ("tum", {"rgb.txt": "\nsoon rgb/a.png\n"}, "rgb.txt:2: 'soon', expected 1 finite numbers a line, stamp_s"),
        ("tum", {"rgb.txt": "1.0 rgb/a\x1b.png\n"}, "rgb.txt:1: no file is named after the stamp"),
        ("tum", {"rgb.txt": "1.0 a.png\n1.0 b.png\n"}, "rgb.txt:2: 1.000000 s is not after 1.000000 s"),
        ("yolo", {"images/a.png": "", "labels/b.txt": ""}, "no label file for any of the 1 pictures"),
        ("yolo", {"images/a.png": "", "labels/a.txt": "0.5 0.5 0.5 0.1 0.1\n"}, "class 0.5 is not a whole number"),
        ("drive", LENS_FILE, "neither images/ nor"),
        ("drive", LENS_FILE | {"images/a.png": "", "poses.tum": "0 0 0 0 -.5 .5 -.5 .5\n"}, "z axes are 90 deg off"),
    ],
)  # fmt: skip
def test_a_folder_that_cannot_be(tmp_path, kind, files, words):
    text = refusal(f"{kind}:{folder_of(tmp_path, files)}")
    assert words in text
    assert text.isprintable()


def test_missing_things_are_named(tmp_path):
    for kind in ("kitti", "drive"):
        assert f"{tmp_path / 'none'}: no such folder" in refusal(f"{kind}:{tmp_path / 'none'}")
    (tmp_path / "empty").mkdir()
    assert f"{tmp_path / 'empty'}: no pictures in it" in refusal(f"kitti:{tmp_path / 'empty'}")
    kitti(tmp_path / "k")
    (tmp_path / "k" / "poses.txt").unlink()
    assert refusal(f"kitti:{tmp_path / 'k'}").endswith("poses.txt: cannot be read (No such file or directory)")
    assert "not KIND:DIR with KIND one of kitti, tum, c2w, drive, euroc, locobot, yolo" in refusal("kity:here")


def test_poses_of_no_upright_world_leave_the_pictures(tmp_path, capsys):
    """A world that is the first camera's: its z is ahead, not up."""
    folder = tmp_path / "walk"
    write_pictures(folder / "image", 2)
    (folder / "K.txt").write_text("50 0 32 0 51 24 0 0 1")
    (folder / "poses.txt").write_text(2 * POSE)
    drive = open_drive(f"c2w:{folder}")
    assert (len(drive.images), drive.truth, drive.attitudes) == (2, None, None)
    assert "no true poses: pose 0 looks straight along world_up 'z'" in capsys.readouterr().err


def test_c2w_reads_its_lens(tmp_path):
    folder = tmp_path / "c"
    write_pictures(folder / "image", 2)
    # z up, camera level and facing world x; then one metre on
    line = "0 0 1 {} -1 0 0 0 0 -1 0 1 0 0 0 1\n"
    (folder / "poses.txt").write_text(line.format(0) + line.format(1))
    (folder / "K.txt").write_text("50 0 32\n0 51 24\n0 0 1\n")
    drive = open_drive(f"c2w:{folder}")
    assert drive.intrinsics == Intrinsics(64, 48, 50.0, 51.0, 32.0, 24.0)
    assert drive.truth.poses[1].vector() == pytest.approx([1.0, 0.0, 0.0])
    assert drive.depth == ()
    for path in (folder / "image").iterdir():  # as well in the folder itself
        path.rename(folder / path.name)
    (folder / "image").rmdir()
    assert len(open_drive(f"c2w:{folder}").images) == 2


def tum(folder, step_s, first_s, last_s):
    """Four pictures from 10 s on, and truth between two stamps: optical axes facing world x, z up."""
    write_pictures(folder / "rgb", 4)
    (folder / "rgb.txt").write_text("# stamp file\n" + "".join(f"{10 + i * step_s} rgb/{i}.png\n" for i in range(4)))
    rows = [f"{stamp:.2f} {stamp - 10} 0 1 -0.5 0.5 -0.5 0.5\n" for stamp in np.arange(first_s, last_s, 0.05)]
    (folder / "groundtruth.txt").write_text("# truth\n" + "".join(rows))
    return open_drive(f"tum:{folder}")


def test_tum_interpolates_its_truth_and_leaves_out_pictures_without(tmp_path):
    drive = tum(tmp_path, 0.1, 10.05, 10.26)
    assert [path.name for path in drive.images] == ["0.png", "1.png", "2.png", "3.png"]
    found = [pose.vector().tolist() for pose in drive.truth.poses]
    assert found[2] == pytest.approx([0.15, 0.0, 0.0], abs=1e-6)  # the first picture's truth is that at 10.05 s


def test_tum_drops_what_lies_outside(tmp_path):
    drive = tum(tmp_path, 1, 11.0, 12.01)
    assert [path.name for path in drive.images] == ["1.png", "2.png"]
    assert drive.truth.poses[1].x_m == pytest.approx(1.0)
    (tmp_path / "groundtruth.txt").write_text("50 0 0 1 -0.5 0.5 -0.5 0.5\n")
    assert "covers 50.000 to 50.000 s, no picture" in refusal(f"tum:{tmp_path}")


def test_tum_with_pictures_and_poses(tmp_path):
    write_pictures(tmp_path / "images", 2)
    (tmp_path / "poses.tum").write_text("1.0 0 0 1 -0.5 0.5 -0.5 0.5\n1.5 0 2 1 -0.5 0.5 -0.5 0.5\n")
    drive = open_drive(f"tum:{tmp_path}")
    assert drive.rate_hz == pytest.approx(2.0)
    assert drive.truth.poses[1].vector() == pytest.approx([0.0, 2.0, 0.0])
    (tmp_path / "poses.tum").write_text("1.0 0 0 1 0 0 0 0\n")
    assert "poses.tum:1: quaternion has length 0.000" in refusal(f"tum:{tmp_path}")


def test_our_own_layout_comes_back(tmp_path):
    chair = {
        "id": "chair-1", "label": "chair", "x_m": 1.5, "y_m": -0.5, "on_floor": True, "footprint_m": [[1, -1], [2, -1],
        [2, 0], [1, 0]], "width_m": 0.5, "depth_m": 0.5, "height_m": 0.9, "visible_frames": 3,
    }  # fmt: skip
    box = {"id": "chair-1", "label": "chair", "box": [1, 2, 30, 40], "visible": 0.5}
    spec = own(tmp_path / "d", objects=[chair], boxes=[[box], [], [box]], wheel=[(7.0, 0, 0, 0), (7.1, 0.1, 0, 0.01)])
    drive = open_drive(spec)
    assert drive.truth.poses[2].vector() == pytest.approx([1.0, 0.0, 0.0], abs=1e-6)
    np.testing.assert_allclose(drive.stamps_s, [7.0, 7.1, 7.2])
    assert drive.intrinsics == LENS
    entry = drive.objects[0]
    assert entry["footprint_m"] == [(1, -1), (2, -1), (2, 0), (1, 0)]
    assert (entry["id"], entry["on_floor"], entry["visible_frames"]) == ("chair-1", True, 3)
    assert [frame.labels for frame in drive.boxes] == [("chair",), (), ("chair",)]
    np.testing.assert_array_equal(drive.boxes[2].boxes, [[1, 2, 30, 40]])
    assert drive.wheel.poses == (SE2(), SE2(0.1, 0.0, 0.01))


def test_visibility_is_counted_from_the_boxes_where_the_file_does_not_say(tmp_path):
    def box(side, visible):
        return [{"id": 4, "label": "chair", "box": [0, 0, side, 5], "visible": visible}]

    spec = own(
        tmp_path / "d",
        objects=[{"id": 4, "label": "chair", "x_m": 1, "y_m": 0}],
        boxes=[box(30, 0.9), box(20, 0.9), box(30, 0.2)],  # seen; too small; too hidden
    )
    assert open_drive(spec).objects[0]["visible_frames"] == 1


@pytest.mark.parametrize(
    ("name", "content", "text"),
    [
        ("poses.tum", "7.0 0 0 0 0 0 0 1\n", "poses.tum: 1 lines for the 3 pictures"),
        ("poses.tum", "7.0 nan 0 0 0 0 0 1\n", "poses.tum:1: x_m is nan, must be -1e+06 to 1e+06"),
        ("poses.tum", "7 0 0 0 0 0 0 1\n" * 3, "poses.tum:2: at 7.000000 s, not after 7.000000 s"),
        ("boxes.json", '{"frames": [[]]}', "boxes.json: 1 lines for the 3 pictures"),
        ("boxes.json", "{", "boxes.json: "),
        ("objects.json", '{"objects": [{"id": 1, "x_m": 0, "y_m": 0}]}', "missing required field `label`"),
        ("camera.yaml", "width: 640", "camera.yaml: Object missing required field"),
        ("stamps.txt", "7.0\n7.1\n7.1\n", "stamps.txt:3: 7.100000 s is not after 7.100000 s"),
        ("stamps.txt", "7.0\n7.1\n9.0\n", "covers 7.000 to 7.200 s, the pictures lie at 7.000 to 9.000 s"),
    ],
)
def test_what_is_wrong_with_our_own_layout_is_named(tmp_path, name, content, text):
    spec = own(tmp_path / "d")
    (tmp_path / "d" / name).write_text(content)
    message = refusal(spec)
    assert text in message
    assert str(tmp_path / "d") in message


def test_locobot_truth_is_its_odometry_unless_there_is_better(tmp_path):
    write_pictures(tmp_path / "rgb", 2)
    write_pictures(tmp_path / "depth", 2)
    write_locobot(tmp_path, CameraFile(LENS, MOUNT, 10.0), [(3.0, 1.0, 1.0, math.pi / 2), (3.1, 1.0, 1.4, math.pi / 2)])
    drive = open_drive(f"locobot:{tmp_path}")
    assert drive.truth.poses[1].vector() == pytest.approx([0.4, 0.0, 0.0], abs=1e-5)
    assert len(drive.depth) == 2
    better = Trajectory(np.array([3.0, 3.1]), (SE2(), SE2(0.5, 0.0, 0.0)))
    write_locobot(tmp_path, CameraFile(LENS, MOUNT, 10.0), [(3.0, 0, 0, 0), (3.1, 0.4, 0, 0)], better)
    assert open_drive(f"locobot:{tmp_path}").truth.poses[1].x_m == pytest.approx(0.5)
    (tmp_path / "odometry.csv").write_text("stamp_s,x_m,y_m,yaw_rad\n3.0,nan,0,0\n")
    assert "odometry.csv:2: x_m is nan" in refusal(f"locobot:{tmp_path}")


def test_yolo_labels_become_pixels(tmp_path):
    write_pictures(tmp_path / "images", 2)
    (tmp_path / "labels").mkdir()
    (tmp_path / "labels" / "0.txt").write_text("56 0.5 0.5 0.25 0.5\n")
    drive = open_drive(f"yolo:{tmp_path}")
    np.testing.assert_allclose(drive.boxes[0].boxes, [[24, 12, 40, 36]])
    assert drive.boxes[0].labels == ("chair",)
    assert drive.boxes[1].boxes.shape == (0, 4)
    assert drive.truth is None
    (tmp_path / "labels" / "0.txt").write_text("80 0.5 0.5 0.25 0.5\n")
    assert "0.txt:1: class is 80, must be 0 to 79" in refusal(f"yolo:{tmp_path}")


@pytest.mark.parametrize("above", [False, True])
def test_yolo_names_are_those_of_a_data_yaml(above, tmp_path):
    folder = tmp_path / "train"
    (folder / "labels").mkdir(parents=True)
    write_pictures(folder / "images", 1)
    (folder / "labels" / "0.txt").write_text("1 0.5 0.5 0.2 0.2\n")
    ((tmp_path if above else folder) / "data.yaml").write_text("nc: 2\nnames: {0: chair, 1: couch}\n")
    drive = open_drive(f"yolo:{folder}")
    assert drive.boxes[0].labels == ("couch",)


def test_boxes_json_beside_yolo_labels_tells_what_is_hidden(tmp_path):
    write_pictures(tmp_path / "images", 2)
    boxes = [{"id": 1, "label": "chair", "box": [1, 2, 30, 40], "visible": 0.25}]
    (tmp_path / "boxes.json").write_text(json.dumps({"frames": [boxes, []]}))
    drive = open_drive(f"yolo:{tmp_path}")
    assert drive.boxes[0].visible.tolist() == [0.25]
    assert drive.boxes[0].ignorable().tolist() == [True]
    (tmp_path / "boxes.json").write_text(json.dumps({"frames": [boxes]}))
    assert "1 lines for the 2 pictures" in refusal(f"yolo:{tmp_path}")


@pytest.mark.parametrize("pitch_deg", [0.0, 20.0, -35.0])
@pytest.mark.parametrize("roll_deg", [0.0, 8.0])
@pytest.mark.parametrize("up", ["x", "y", "z", "-x", "-y", "-z"])
def test_any_world_axis_pitch_and_roll_give_back_the_way(pitch_deg, roll_deg, up):
    mount = Mount.from_degrees(0.8, pitch_deg, roll_deg, forward_m=0.15, left_m=-0.05)
    way = [SE2(), SE2(0.5, 0.1, 0.4), SE2(0.7, 0.5, 2.0), SE2(0.1, -0.4, -2.8)]
    axis = up_vector(up)
    other = np.roll(axis, 1)
    world_base = np.column_stack([other, np.cross(axis, other), axis])  # where base x, y, z lie in the world
    poses = []
    for pose in way:
        base = np.eye(4)
        base[:2, :2], base[:2, 3] = pose.rotation(), (pose.x_m, pose.y_m)
        lens = np.eye(4)
        lens[:3, :3], lens[:3, 3] = mount.rotation_base_optical(), mount.position_base_m()
        world = np.eye(4)
        world[:3, :3], world[:3, 3] = world_base, (3.0, -2.0, 1.0)
        poses.append(world @ base @ lens)
    found = planarise(np.array(poses), up, "z", mount)
    for ours, true in zip(found, way, strict=True):
        assert ours.vector() == pytest.approx(true.vector(), abs=1e-9)
    lever = np.array([mount.forward_m, mount.left_m])
    for full, true in zip(upright_camera(np.array(poses), up, mount), way, strict=True):
        turn = np.eye(3)
        turn[:2, :2] = true.rotation()
        np.testing.assert_allclose(full[:3, :3], turn, atol=1e-9)
        np.testing.assert_allclose(full[:3, 3], [*(true.apply(lever) - lever), 0.0], atol=1e-9)


def test_real_kitti_drives_ahead_and_its_left_turn_is_positive(shared_data):
    folder = shared_data / "kitti00"
    drive = open_drive(f"kitti:{folder}")
    matrices = np.loadtxt(folder / "poses.txt").reshape(-1, 3, 4)
    found = np.array([pose.vector() for pose in drive.truth.poses])
    np.testing.assert_allclose(found[:, 0], matrices[:, 2, 3], atol=1e-6)  # ahead is the world's z
    np.testing.assert_allclose(found[:, 1], -matrices[:, 0, 3], atol=1e-6)  # left is against its x
    # scipy's yaw about the downward y axis, turned round
    about_down = Rotation.from_matrix(matrices[:, :, :3]).as_euler("YXZ")[:, 0]
    np.testing.assert_allclose(np.sin(found[:, 2] + about_down), 0.0, atol=1e-6)
    np.testing.assert_allclose(drive.full_poses[:, :2, 3], found[:, :2], atol=1e-6)
    np.testing.assert_allclose(drive.full_poses[:, 2, 3], -matrices[:, 1, 3], atol=1e-6)
    assert drive.rate_hz == 10.0
    assert len(drive.images) == 700
    assert drive.mount.height_m == 1.65
