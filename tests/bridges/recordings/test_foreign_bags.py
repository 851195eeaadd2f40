"""Bags of others: which topics are taken, their containers, clocks, lenses, mounts and depth; nothing in silence."""

import re
import sqlite3
import struct
from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("rosbags")

from rosbags.convert import convert
from rosbags.rosbag2 import StoragePlugin
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from support.ros_bag import camera_info, compressed, image, imu, make, odometry, tf, transform, write_bag

from edgemap.bridges.ros2.recordings.foreign import read_wheel
from edgemap.runtime.frames.camera import CameraOptions, next_frame
from edgemap.runtime.frames.errors import CameraError
from edgemap.runtime.frames.faults import collected
from edgemap.runtime.inputs.open import open_camera

K = [58.0, 0.0, 31.5, 0.0, 58.0, 23.5, 0.0, 0.0, 1.0]
T0, STEP = 1_700_000_000_000_000_000, 10**8
BGR = np.random.default_rng(2).integers(0, 256, (48, 64, 3), dtype=np.uint8)
DEPTH = np.full((48, 64), 1500, np.uint16)
MOUNT = tf(
    transform("base_footprint", "camera_link", (0.15, 0.0, 0.6), (0.0, 11.5, 0.0)),
    transform("camera_link", "cam_optical", (0.0, 0.0, 0.0), (-90.0, 0.0, -90.0)),
)


def depth_image(stamp_ns, values, encoding="16UC1"):
    rows = np.ascontiguousarray(values).view(np.uint8).reshape(len(values), -1)
    return replace(image(stamp_ns, rows, encoding), width=values.shape[1])


def played(path, **how):
    """Frames and faults of all kinds, and what the camera says of itself."""
    faults = []
    with open_camera(str(path), CameraOptions(**how)) as camera:
        frames = iter(lambda: next_frame(camera, lambda fault: faults.append(fault.fault)), None)
        return list(frames), [*camera.info.faults, *faults, *camera.account()], camera.info


@pytest.mark.parametrize("first", [
    ("/camera/depth/image_rect_raw", lambda t: depth_image(t, DEPTH)),
    ("/d/compressedDepth", lambda t: compressed(t, struct.pack("<iff", 0, 0, 0), "16UC1; compressedDepth png")),
    ("/camera/infra1/image_rect_raw", lambda t: image(t, BGR[:, :, :1], "mono8")),
])  # fmt: skip
def test_colour_is_taken_before_what_was_recorded_before_it_and_the_rest_is_listed(tmp_path, first):
    messages = [("/tf_static", T0, MOUNT), ("/odom", T0, odometry(T0, 0.0, 0.0, 0.0))]
    messages += [(first[0], T0, first[1](T0)), ("/depth_cam/color/image_raw", T0, image(T0, BGR, "bgr8"))]
    frames, _, info = played(write_bag(tmp_path / "bag", messages))
    np.testing.assert_array_equal(frames[0].image, BGR)
    taken, left = info.notes
    assert "/depth_cam/color/image_raw (1 pictures)" in taken
    assert f"{first[0]} (" in left
    assert "--topics wheels=/odom" in left


def test_infrared_and_ten_bits_of_grey_are_taken_and_named(tmp_path):
    depth = ("/camera/depth/image_rect_raw", T0, depth_image(T0, DEPTH))
    grey = ("/camera/infra1/image_rect_raw", T0, image(T0, BGR[:, :, :1], "mono8"))
    assert "infrared" in played(write_bag(tmp_path / "a", [depth, grey]))[2].notes[0]
    two = ("/other/depth/image", T0, depth_image(T0, DEPTH))
    with pytest.raises(CameraError, match=r"no topic .* of colour or grey; has /camera/depth/image_rect_raw \(depth\)"):
        open_camera(str(write_bag(tmp_path / "b", [depth, two])))
    grey = BGR[:, :, 0].astype(np.uint16) * 4
    frames, _, info = played(write_bag(tmp_path / "bag", [("/cam/image_raw", T0, depth_image(T0, grey, "mono16"))]))
    np.testing.assert_array_equal(frames[0].image[:, :, 1], BGR[:, :, 0])
    assert "16 bits, of which 10 are used" in info.notes[-1]


@pytest.mark.parametrize("kind", ["folder", "split", "db3", "db3 folder", "ros1"])
def test_every_container_of_a_bag_plays_alike(tmp_path, kind):
    stamps = [T0 + index * STEP for index in range(4)]
    messages = [("/tf_static", T0 - 1, MOUNT), ("/cam/camera_info", T0 - 1, camera_info(64, 48, K, [0.0] * 5))]
    for stamp in stamps:
        messages.append(("/cam/image_raw", stamp, image(stamp, BGR, "bgr8")))
        messages.append(("/odom", stamp, odometry(stamp, 0.1, 0.0, 0.0)))
    folder, spec = tmp_path / "bag", tmp_path / "bag"
    if kind == "ros1":
        spec, store = tmp_path / "bag.bag", get_typestore(Stores.ROS1_NOETIC)
        store.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", "tf2_msgs/msg/TFMessage"))
        bag = write_bag(folder, messages).parent
        convert([bag], spec, "sqlite3", 8, None, "file", None, store, (), (), (), ())
    elif kind == "split":
        for part, chosen in enumerate((messages[:6], messages[6:])):
            file = write_bag(tmp_path / f"part{part}", chosen)
            folder.mkdir(exist_ok=True)
            file.rename(folder / f"bag_{9 + part}.mcap")  # 9 comes before 10
        (folder / "metadata.yaml").write_text("rosbag2_bagfile_information: {}")
    else:
        file = write_bag(folder, messages, StoragePlugin.MCAP if kind == "folder" else StoragePlugin.SQLITE3)
        spec = file if kind == "db3" else folder
    frames, faults, info = played(spec)
    assert [round(frame.stamp_s * 1e9) // 10**6 for frame in frames] == [stamp // 10**6 for stamp in stamps]
    assert not faults
    assert info.intrinsics.fx == 58.0
    assert info.mount.height_m == pytest.approx(0.6)
    np.testing.assert_array_equal(frames[3].image, BGR)
    assert read_wheel(str(spec)).poses[-1].x_m == pytest.approx(0.1)


@pytest.mark.parametrize("damage", [b"SQLite format 3\0" + bytes(100), b"rubbish", b""])
def test_what_is_no_bag_is_one_line(tmp_path, damage):
    for name in ("bag.db3", "bag.bag"):
        (tmp_path / name).write_bytes(damage)
        with pytest.raises(CameraError, match=rf"{name}: no ") as refused:
            open_camera(str(tmp_path / name))
        assert "\n" not in str(refused.value)
    (tmp_path / "metadata.yaml").write_text("rosbag2_bagfile_information: {}")
    (tmp_path / "bag.db3").rename(tmp_path / "bag.db3.zstd")
    with pytest.raises(CameraError, match=r"bag\.db3\.zstd is compressed"):
        open_camera(str(tmp_path))


def test_a_recording_of_librealsense_is_not_taken_for_a_bag(tmp_path):
    with sqlite3.connect(tmp_path / "d435.db3") as file:
        file.execute("CREATE TABLE topics (id, name, type, serialization_format)")
        file.execute("CREATE TABLE messages (id, topic_id, timestamp, data)")
        file.execute("INSERT INTO topics VALUES (1, '/device_0/info', 'diagnostic_msgs/msg/KeyValue', 'cdr')")
    with pytest.raises(CameraError, match="pass realsense:"):
        open_camera(str(tmp_path / "d435.db3"))


@pytest.mark.parametrize(
    ("stamp", "used", "fault"),
    [
        (lambda i: 0 if i == 10 else T0 + i * STEP, 29, "not after"),
        (lambda i: 0 if i == 0 else T0 + i * STEP, 29, "more than a day before"),
        (lambda i: T0 + (i + 36_000 * (i == 10)) * STEP, 29, "after the stamps that follow"),
        (lambda i: T0 + (i - (i == 10)) * STEP, 29, "not after"),
        (lambda i: T0 + (i - 36_000 * (i >= 10)) * STEP, 30, "the clock was set by -3600.000 s"),
        (lambda i: i * STEP + 10**9 if i < 10 else T0 + i * STEP, 30, r"the clock was set by \+"),
        (lambda i: T0 + (i + 36_000 * (i >= 10)) * STEP, 30, r"the clock was set by \+3600.000 s"),
        (lambda i: 0, 30, "no stamps, the times of recording are taken"),
    ],
    ids=["zero", "zero first", "far future", "duplicate", "set back", "set by NTP", "set forward", "no stamps"],
)
def test_one_bad_stamp_is_one_fault_and_a_clock_that_was_set_is_followed(tmp_path, stamp, used, fault):
    messages = [("/cam/image_raw", T0 + i * STEP, image(stamp(i), BGR, "bgr8")) for i in range(30)]
    messages += [("/odom", T0 + i * STEP, odometry(stamp(i), 0.01 * i, 0.0, 0.0)) for i in range(30)]
    path = write_bag(tmp_path / "bag", messages)
    frames, faults, _ = played(path)
    assert len(frames) == used
    assert len(faults) == 1
    assert re.search(fault, faults[0].text)
    steps = np.diff([frame.stamp_s for frame in frames])
    assert steps.min() > 0.09
    assert steps.max() < 0.21
    with collected() as notes:
        wheels = read_wheel(str(path))
    assert len(wheels.poses) == used
    dropped = [("1 of 30 samples dropped" in one.text, bool(re.search(fault, one.text))) for one in notes]
    assert dropped == [(used < 30, True)]
    assert wheels.stamps_s[-1] == pytest.approx(frames[-1].stamp_s, abs=0.11)


def test_a_pause_and_messages_that_waited_are_no_clock_that_was_set(tmp_path):
    stamps = [T0 + (i + 100 * (i >= 10) + 50 * (i >= 20)) * STEP for i in range(30)]
    logged = [max(at, T0 + 155 * STEP) if i < 20 and i >= 15 else at for i, at in enumerate(stamps)]
    messages = [("/cam/image_raw", log, image(at, BGR, "bgr8")) for log, at in zip(logged, stamps, strict=True)]
    frames, faults, _ = played(write_bag(tmp_path / "bag", messages))
    assert [round(frame.stamp_s * 1e9) - T0 for frame in frames] == pytest.approx([at - T0 for at in stamps], abs=1000)
    assert faults == []


def test_one_picture_of_another_size_and_samples_that_are_none_are_counted(tmp_path):
    pictures = [BGR[:40] if i == 3 else BGR for i in range(6)]
    messages = [("/cam/image_raw", T0 + i * STEP, image(T0 + i * STEP, one, "bgr8")) for i, one in enumerate(pictures)]
    frames, faults, _ = played(write_bag(tmp_path / "bag", messages))
    assert (len(frames), [fault.kind for fault in faults]) == (5, ["size"])
    poses = [odometry(T0 + i * STEP, 0.01 * i, 0.0, 0.0) for i in range(20)]
    poses[0].pose.pose.orientation.w = 0.0
    path = write_bag(tmp_path / "wheels", [("/odom", T0 + i * STEP, pose) for i, pose in enumerate(poses)])
    with collected() as notes:
        assert len(read_wheel(str(path)).poses) == 19
    assert "1 of 20 samples dropped" in notes[0].text
    parts = tf(*MOUNT.transforms, transform("cam_optical", "imu_link", (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)))
    samples = [imu(T0 + i * 10**7, (0.0, float("nan") if i == 5 else 0.0, 0.0), (0.0, -9.8, 0.0)) for i in range(20)]
    messages = [("/tf_static", T0, parts), ("/cam/image_raw", T0, image(T0, BGR, "bgr8"))]
    messages += [("/imu", T0 + i * 10**7, sample) for i, sample in enumerate(samples)]
    _, faults, info = played(write_bag(tmp_path / "imu", messages))
    assert len(info.imu) == 19
    assert "1 of 20 samples dropped" in faults[0].text


FLOATS, MILLIMETRES = DEPTH.astype(np.float32), "32FC1 is in millimetres"
SMALL = "depth: 0 of 3 pictures usable: 32x24 px for pictures of 64x48 px"


@pytest.mark.parametrize(("sent", "text"), [(DEPTH[::2, ::2], SMALL), (FLOATS, MILLIMETRES), (FLOATS / 1000, None)])
def test_depth_that_cannot_be_used_is_a_fault_and_millimetres_are_found_out(tmp_path, sent, text):
    messages = []
    for stamp in (T0, T0 + STEP, T0 + 2 * STEP):
        messages.append(("/camera/color/image_raw", stamp, image(stamp, BGR, "bgr8")))
        encoding = "16UC1" if sent.dtype == np.uint16 else "32FC1"
        messages.append(("/camera/aligned_depth_to_color/image_raw", stamp, depth_image(stamp, sent, encoding)))
    frames, faults, _ = played(write_bag(tmp_path / "bag", messages))
    assert [text in fault.text for fault in faults] == ([True] if text else [])
    if sent.shape == (48, 64):
        np.testing.assert_allclose(frames[0].depth, 1.5, atol=1e-6)


def test_depth_at_other_times_is_a_fault(tmp_path):
    messages = [("/camera/color/image_raw", T0, image(T0, BGR, "bgr8"))]
    messages += [("/camera/aligned_depth_to_color/image_raw", T0 + 1, depth_image(T0 + STEP, DEPTH))]
    assert "0 of 1 pictures usable: none at the time" in played(write_bag(tmp_path / "bag", messages))[1][0].text


@pytest.mark.parametrize(
    ("size", "binning", "roi", "expected"),
    [
        ((64, 48), 0, (0, 0, 0, 0), (58.0, 31.5)),
        ((64, 48), 2, (0, 0, 0, 0), (58.0, 31.5)),  # K is that of the pictures already
        ((128, 96), 2, (0, 0, 0, 0), (29.0, 15.5)),
        ((128, 96), 0, (0, 0, 0, 0), (29.0, 15.5)),
        ((80, 80), 0, (10, 20, 48, 64), (58.0, 21.5)),  # x and y offset, height, width
    ],
)
def test_numbers_of_the_sensor_become_those_of_the_pictures(tmp_path, size, binning, roi, expected):
    region = make("sensor_msgs/msg/RegionOfInterest", *roi, False)
    info = replace(camera_info(*size, K, [0.0] * 5), binning_x=binning, binning_y=binning, roi=region)
    messages = [("/cam/camera_info", T0, info), ("/cam/image_raw", T0, image(T0, BGR, "bgr8"))]
    with open_camera(str(write_bag(tmp_path / "bag", messages))) as camera:
        lens = camera.info.intrinsics
        assert (lens.width, lens.height) == (64, 48)
        assert (lens.fx, lens.cx) == pytest.approx(expected)
        assert camera.read() is not None


@pytest.mark.parametrize(
    ("angles", "rotate", "expected", "text"),
    [
        ((0.0, 11.5, 0.0), 0, 11.5, "axes of a body"),
        ((0.0, 11.5, 5.0), 0, None, "0.60 m up, looking 11.5 deg down and 5.0 deg to the left"),
        ((180.0, 11.5, 0.0), 0, None, "--rotate 180"),
        ((180.0, 11.5, 0.0), 180, 11.5, "taken"),
        ((90.0, 0.0, 0.0), 0, None, "--rotate "),
    ],
)
def test_a_mount_of_tf_is_used_or_named(tmp_path, angles, rotate, expected, text):
    optical = (-90.0, 0.0, -90.0) if angles[0] else (0.0, 0.0, 0.0)
    camera = transform("camera_link", "cam_optical", (0.0, 0.0, 0.0), optical)
    tree = tf(transform("base_footprint", "camera_link", (0.15, 0.0, 0.6), angles), camera)
    messages = [("/tf_static", T0, tree), ("/cam/image_raw", T0, image(T0, BGR, "bgr8"))]
    info = played(write_bag(tmp_path / "bag", messages), rotate=rotate)[2]
    assert (info.mount and round(np.degrees(info.mount.pitch_rad), 6)) == expected
    assert any(text in note for note in info.notes), info.notes
