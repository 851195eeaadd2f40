"""ROS 2 bags of other people's robots as cameras: encodings, lens, mount, wheels, and one line for what is missing."""

import struct

import cv2
import numpy as np
import pytest

pytest.importorskip("rosbags")

from mcap.writer import CompressionType, IndexType
from support.recordings import bag, drain
from support.ros_bag import STORE, camera_info, compressed, image, imu, odometry, tf, transform, write_bag

from edgemap.geometry.camera.intrinsics import Distortion, Intrinsics
from edgemap.runtime.frames.camera import CameraOptions, SensorTopics, next_frame
from edgemap.runtime.frames.errors import CameraError
from edgemap.runtime.inputs.open import open_camera

K = [58.0, 0.0, 31.0, 0.0, 59.0, 23.0, 0.0, 0.0, 1.0]
T0 = 1_700_000_000_123_456_789
BGR = np.random.default_rng(2).integers(0, 256, (48, 64, 3), dtype=np.uint8)
GREY = np.repeat(BGR[:, :, :1], 3, axis=2)
PNG = cv2.imencode(".png", BGR)[1].tobytes()


def play(path):
    with open_camera(str(path)) as camera:
        return drain(camera)


@pytest.mark.parametrize(
    ("encoding", "sent", "expected"),
    [
        ("bgr8", BGR, BGR),
        ("rgb8", BGR[:, :, ::-1], BGR),
        ("mono8", BGR[:, :, :1], GREY),
        ("bgra8", np.dstack([BGR, BGR[:, :, :1]]), BGR),
        ("rgba8", np.dstack([BGR[:, :, ::-1], BGR[:, :, :1]]), BGR),
    ],
)
@pytest.mark.parametrize("pad", [0, 5])
def test_raw_pictures(tmp_path, encoding, sent, expected, pad):
    sent = np.ascontiguousarray(sent)
    messages = [("/cam/image_raw", T0 + i * 10**8, image(T0 + i * 10**8, sent, encoding, pad)) for i in range(3)]
    frames = play(write_bag(tmp_path / "bag", messages))
    assert [frame.stamp_s for frame in frames] == [float(f"{(T0 + i * 10**8) / 10**9!r}") for i in range(3)]
    for frame in frames:
        np.testing.assert_array_equal(frame.image, expected)


@pytest.mark.parametrize("form", ["png", "bgr8; png compressed bgr8", ""])
def test_compressed_pictures(tmp_path, form):
    path = write_bag(tmp_path / "bag", [("/cam/image_raw/compressed", T0, compressed(T0, PNG, form))])
    np.testing.assert_array_equal(play(path)[0].image, BGR)


def test_lens_and_mount_are_found(tmp_path):
    """The URDF of a robot: base_footprint, base_link 0.1 m up, the camera 0.5 m above it, tilted down by 12 degrees."""
    messages = [
        ("/tf_static", T0, tf(
            transform("base_footprint", "base_link", (0.0, 0.0, 0.1), (0, 0, 0)),
            transform("base_link", "camera_link", (0.2, 0.03, 0.5), (0, 12, 0)),
        )),
        ("/tf_static", T0, tf(transform("camera_link", "cam_optical", (0.0, 0.0, 0.0), (-90, 0, -90)))),
        ("/other/camera_info", T0, camera_info(64, 48, [1.0] * 9, [])),
        ("/cam/camera_info", T0, camera_info(64, 48, K, [0.1, 0.2, 0.001, 0.002, 0.3])),
        ("/cam/image_raw", T0, image(T0, BGR, "bgr8")),
    ]  # fmt: skip
    with open_camera(str(write_bag(tmp_path / "bag", messages))) as camera:
        distortion = Distortion("brown_conrady", (0.1, 0.2, 0.001, 0.002, 0.3))
        assert camera.info.intrinsics == Intrinsics(64, 48, 58.0, 59.0, 31.0, 23.0, distortion)
        mount = camera.info.mount
    found = (mount.height_m, mount.pitch_rad, mount.roll_rad, mount.forward_m, mount.left_m)
    np.testing.assert_allclose(found, [0.6, np.radians(12), 0.0, 0.2, 0.03], atol=1e-9)


def imu_bag(folder, linked=True):
    """Four pictures at 10 Hz and an IMU at 100 Hz on a level robot, its own x axis to the robot's left."""
    parts = [transform("base_link", "cam_optical", (0.2, 0.0, 0.5), (-90, 0, -90))]
    parts += [transform("base_link", "imu_link", (0.0, 0.0, 0.1), (0, 0, 90))] * linked
    messages = [("/tf_static", T0, tf(*parts))]
    for i in range(40):
        stamp = T0 + i * 10**7
        messages.append(("/imu/data", stamp, imu(stamp, (0.01 * i, 0.2, 0.3), (0.5, 0.0, 9.81))))
    messages += [("/cam/image_raw", T0 + i * 10**8, image(T0 + i * 10**8, BGR, "bgr8")) for i in range(4)]
    return write_bag(folder, messages)


def test_inertial_samples_come_with_the_pictures_in_optical_axes(tmp_path):
    frames = play(imu_bag(tmp_path / "bag"))
    assert [len(frame.imu) for frame in frames] == [1, 10, 10, 10]
    samples = frames[2].imu
    # The IMU's x is left: the robot's -y in optical x. Its y points backwards: optical -z. z is up: optical -y.
    np.testing.assert_allclose(samples.gyro_rad_s[0], [-0.11, -0.3, -0.2], atol=1e-9)
    np.testing.assert_allclose(samples.accel_m_s2[0], [-0.5, -9.81, 0.0], atol=1e-9)
    assert samples.stamps_s[-1] == frames[2].stamp_s


def test_an_imu_that_tf_does_not_join_is_left_out_unless_it_was_asked_for(tmp_path):
    path = imu_bag(tmp_path / "bag", linked=False)
    assert not any(len(frame.imu) for frame in play(path))
    with pytest.raises(CameraError, match=r"tf does not join the frame of /imu/data to the pictures' \(cam_optical\)"):
        open_camera(str(path), CameraOptions(topics=SensorTopics(imu="/imu/data")))
    with pytest.raises(CameraError, match=r"no sensor_msgs/Imu topic /imu \(there are: /imu/data\)"):
        open_camera(str(path), CameraOptions(topics=SensorTopics(imu="/imu")))


def test_rectified_pictures_have_no_distortion_and_a_height_over_base_link_is_no_mount(tmp_path):
    mounted = tf(transform("base_link", "cam_optical", (0.2, 0.0, 0.5), (-102, 0, -90)))
    messages = [("/tf_static", T0, mounted), ("/cam/image_raw", T0, image(T0, BGR, "bgr8"))]
    with open_camera(str(write_bag(tmp_path / "bag", messages))) as camera:
        assert (camera.info.mount, camera.info.intrinsics) == (None, None)
    lens = camera_info(64, 48, K, [0.1, 0.2, 0.001, 0.002, 0.3])
    messages = [("/cam/camera_info", T0, lens), ("/cam/image_rect", T0, image(T0, BGR, "bgr8"))]
    with open_camera(str(write_bag(tmp_path / "rectified", messages))) as camera:
        assert camera.info.intrinsics == Intrinsics(64, 48, 58.0, 59.0, 31.0, 23.0)


def test_the_first_picture_topic_is_played_or_the_named_one(tmp_path):
    messages = [
        ("/left/image_raw", T0, image(T0, BGR, "bgr8")),
        ("/right/image_raw", T0, image(T0, np.ascontiguousarray(GREY), "bgr8")),
        ("/odom", T0, odometry(T0, 1.0, 2.0, 0.5)),
    ]
    path = write_bag(tmp_path / "bag", messages)
    np.testing.assert_array_equal(play(path)[0].image, BGR)
    np.testing.assert_array_equal(play(f"{path}#/right/image_raw")[0].image, GREY)
    there = r"\(topics with pictures: /left/image_raw, /right/image_raw\)"
    with pytest.raises(CameraError, match=f"no topic /up {there}"):
        open_camera(f"{path}#/up")
    with pytest.raises(CameraError, match=f"/odom is nav_msgs/Odometry, not pictures {there}"):
        open_camera(f"{path}#/odom")


def test_what_has_no_pictures_or_goes_back_in_time_is_one_line(tmp_path):
    path = write_bag(tmp_path / "bag", [("/odom", T0, odometry(T0, 0.0, 0.0, 0.0))])
    with pytest.raises(CameraError, match=r"no topic with sensor_msgs Image .*; has /odom \(nav_msgs/Odometry\)"):
        open_camera(str(path))
    messages = [("/cam/image_raw", T0 + i, image(T0 - i, BGR, "bgr8")) for i in range(2)]
    with pytest.raises(CameraError, match=r"at 1700000000\.\d+ s, not after 1700000000"):
        play(write_bag(tmp_path / "back", messages))
    with pytest.raises(CameraError, match="a topic of depth goes with pictures of a ROS 2 topic or a recording only"):
        open_camera("demo", CameraOptions(topics=SensorTopics(depth="/cam/depth")))


@pytest.mark.parametrize(
    ("message", "complaint"),
    [
        (image(T0, BGR[:, :, :2], "16UC1"), "Image encoding '16UC1' is not supported .*bgr8"),
        (image(T0, BGR[:, :40], "bgr8", pad=0), None),
        (compressed(T0, PNG, "16UC1; compressedDepth png"), "format '16UC1; compressedDepth png' is not supported"),
        (compressed(T0, b"\0\0\0\1", "h264"), "format 'h264' is not supported"),
        (compressed(T0, PNG[:-40], "png"), "picture is cut short"),
        (compressed(T0, b"rubbish", "jpeg"), "not a picture that OpenCV reads"),
    ],
)
def test_pictures_that_are_not_understood(tmp_path, message, complaint):
    path = write_bag(tmp_path / "bag", [("/cam/image_raw", T0, message)])
    if complaint is None:
        assert play(path)[0].image.shape == (48, 40, 3)
        return
    with pytest.raises(CameraError, match=complaint) as caught:
        open_camera(str(path))
    assert "\n" not in str(caught.value)


def test_an_unknown_lens_is_refused_by_name_unless_another_is_given(tmp_path):
    lens = camera_info(64, 48, K, [0.0] * 4, "double_sphere")
    messages = [("/cam/camera_info", T0, lens), ("/cam/image_raw", T0, image(T0, BGR, "bgr8"))]
    path = str(write_bag(tmp_path / "bag", messages))
    with pytest.raises(CameraError, match="'double_sphere' with 4 coefficients is not supported; pass --intr"):
        open_camera(path)
    lens = Intrinsics(64, 48, 50.0, 50.0, 32.0, 24.0)
    with open_camera(path, CameraOptions(intrinsics=lens)) as camera:
        assert camera.info.intrinsics == lens


@pytest.mark.parametrize("compression", ["ZSTD", "LZ4", "NONE"])
@pytest.mark.parametrize("indexed", [True, False])
def test_chunk_compressions_with_and_without_index(tmp_path, compression, indexed):
    pictures = (image(T0 + i, np.full((48, 64, 3), i, np.uint8), "bgr8") for i in range(5))
    coded = [bytes(STORE.serialize_cdr(message, "sensor_msgs/msg/Image")) for message in pictures]
    messages = [("/cam/image_raw", "sensor_msgs/msg/Image", T0 + i, data) for i, data in enumerate(coded)]
    index = IndexType.ALL if indexed else IndexType.NONE
    options = {"chunk_size": 20_000, "compression": CompressionType[compression], "index_types": index}
    path = bag(tmp_path / "a.mcap", messages, **options)
    with open_camera(str(path)) as camera:
        assert camera.info.frame_count == 5
        # Nanoseconds apart are the same float on a Unix clock, but not to be taken for time that stands still.
        assert [int(frame.image[0, 0, 0]) for frame in drain(camera)] == [0, 1, 2, 3, 4]
    data = path.read_bytes().replace(compression.lower().encode(), b"br!!"[: len(compression)])
    (tmp_path / "b.mcap").write_bytes(data)
    if compression != "NONE":
        with pytest.raises(CameraError, match=r"b\.mcap: (chunks compressed with 'br!|damaged)"):
            play(tmp_path / "b.mcap")


def test_other_encodings_than_cdr_are_named(tmp_path):
    path = bag(tmp_path / "a.mcap", [("/cam", "sensor_msgs/msg/Image", T0, b"{}")], ("jsonschema", "json"))
    with pytest.raises(CameraError, match="/cam is encoded as json/jsonschema, edgemap reads cdr/ros2msg"):
        open_camera(str(path))


def test_damaged_first_pictures_are_told_and_skipped(tmp_path):
    step = 100_000_000
    pictures = [compressed(T0 + i * step, b"rubbish" if i in (0, 1, 4) else PNG, "png") for i in range(6)]
    messages = [("/cam/compressed", T0 + i * step, message) for i, message in enumerate(pictures)]
    faults = []
    with open_camera(str(write_bag(tmp_path / "bag", messages))) as camera:
        frames = list(iter(lambda: next_frame(camera, faults.append), None))
    assert [fault.kind.value for fault in faults] == ["damaged"] * 3
    assert all(str(fault).endswith("skipped") for fault in faults)
    np.testing.assert_allclose([f.stamp_s - T0 / 1e9 for f in frames], [0.2, 0.3, 0.5], atol=1e-6)
    assert [frame.index for frame in frames] == [0, 1, 2]


@pytest.mark.parametrize(("encoding", "kind"), [("16UC1", "<u2"), ("32FC1", "<f4")])
def test_depth_that_is_aligned_to_the_colour_comes_with_the_pictures(tmp_path, encoding, kind):
    """Depth comes 3 ms late and first in the file; of the second picture there is none, the third's is damaged."""
    raw = np.arange(48 * 64).reshape(48, 64)
    sent = (raw if encoding == "16UC1" else raw / 1000.0).astype(kind)
    topic, messages = "/camera/aligned_depth_to_color/image_raw", []
    for i in (0, 2, 3):
        stamp = T0 + i * 10**8 + 3 * 10**6
        message = image(stamp, sent.view(np.uint8), encoding)
        message.width = 64 if i != 2 else 65
        messages.append((topic, stamp, message))
    messages += [("/cam/image_raw", T0 + i * 10**8, image(T0 + i * 10**8, BGR, "bgr8")) for i in range(4)]
    path = write_bag(tmp_path / "bag", messages)
    frames = play(path)
    assert [frame.depth is not None for frame in frames] == [True, False, False, True]
    np.testing.assert_allclose(np.asarray(frames[3].depth), raw / 1000.0, rtol=1e-6)
    with open_camera(str(path), CameraOptions(depth=False)) as camera:
        assert all(frame.depth is None for frame in drain(camera))


@pytest.mark.parametrize("form", ["16UC1; compressedDepth png", "32FC1; compressedDepth png"])
def test_depth_of_a_named_topic_comes_compressed(tmp_path, form):
    """PNG of 16 bits behind twelve bytes; metres as A / (value - B), 0 where unknown, as image_transport has it."""
    depth = np.linspace(0.5, 4.0, 48 * 64, dtype=np.float32).reshape(48, 64)
    scale, offset = (0.0, 0.0) if form.startswith("16UC1") else (10_000.0, 500.0)
    raw = np.rint(depth * 1000.0 if not scale else scale / depth + offset).astype(np.uint16)
    raw[3, 5] = 0
    data = struct.pack("<iff", 0, scale, offset) + cv2.imencode(".png", raw)[1].tobytes()
    messages = [("/cam/depth/compressedDepth", T0, compressed(T0, data, form))]
    messages += [("/cam/image_raw", T0, image(T0, BGR, "bgr8"))]
    path = write_bag(tmp_path / "bag", messages)
    with open_camera(str(path), CameraOptions(topics=SensorTopics(depth="/cam/depth/compressedDepth"))) as camera:
        (frame,) = drain(camera)
    assert frame.depth[3, 5] == 0.0
    known = raw > 0
    np.testing.assert_allclose(frame.depth[known], depth[known], atol=1e-3)
    with pytest.raises(CameraError, match="no topic /nowhere of sensor_msgs"):
        open_camera(str(path), CameraOptions(topics=SensorTopics(depth="/nowhere")))
