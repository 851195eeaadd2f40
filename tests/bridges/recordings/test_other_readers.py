"""Programs that are not edgemap read its recordings: mcap with its ROS 2 decoder, and rosbags, which shares no code."""

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from support.recordings import FACTS, LENS, MOUNT, noise
from support.results import CHAIR, COVARIANCE, OFF, POSES, results

from edgemap.bridges.ros2.messages.build import mount_transform
from edgemap.bridges.ros2.messages.map_messages import markers
from edgemap.bridges.ros2.recordings.recorder import Recorder
from edgemap.geometry.camera.floor import FloorCamera
from edgemap.geometry.camera.mount import Mount
from edgemap.runtime.frames.camera import CameraInfo
from edgemap.runtime.frames.trajectory import Trajectory

highlevel: Any = pytest.importorskip("rosbags.highlevel")
typesys: Any = pytest.importorskip("rosbags.typesys")


@pytest.fixture(scope="module")
def recording(tmp_path_factory) -> Path:
    """A run of twelve pictures with wheels, one box at the feet of a chair, and one object on the map."""
    path = tmp_path_factory.mktemp("run") / "run.mcap"
    frames = noise(12)
    wheel = Trajectory(np.array([frame.stamp_s for frame in frames]), tuple(POSES))
    recorder = Recorder(path, replace(FACTS, wheel=wheel))
    for result in results(frames, POSES):
        recorder.write(result, [CHAIR])
    recorder.close()
    return path


def with_mcap(path):
    """Messages by topic, as mcap and its ROS 2 decoder give them: (log time, message)."""
    from mcap.reader import make_reader
    from mcap_ros2.decoder import DecoderFactory

    found: dict[str, list] = {}
    with path.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True, decoder_factories=[DecoderFactory()])
        assert reader.get_header().profile == "ros2"
        for _, channel, message, decoded in reader.iter_decoded_messages():
            assert message.publish_time == message.log_time
            found.setdefault(channel.topic, []).append((message.log_time, decoded))
    return found


def with_rosbags(path):
    """The same through rosbags, types from the definitions in the file alone."""
    found: dict[str, list] = {}
    with highlevel.AnyReader([path]) as reader:
        for connection, stamp_ns, data in reader.messages():
            found.setdefault(connection.topic, []).append((stamp_ns, reader.deserialize(data, connection.msgtype)))
    return found


@pytest.fixture(params=[with_mcap, with_rosbags], scope="module")
def topics(request, recording):
    return request.param(recording)


def test_every_topic_is_there_at_the_pictures_stamps(topics):
    stamps = [round(frame.stamp_s * 1e9) for frame in noise(12)]
    names = "/camera/image/compressed", "/camera/camera_info", "/odometry", "/pose", "/wheel/odometry", "/detections"
    for name in names:
        assert np.abs(np.array([stamp for stamp, _ in topics[name]]) - stamps).max() < 300, name
        for stamp, message in topics[name]:
            assert message.header.stamp.sec * 10**9 + message.header.stamp.nanosec == stamp
    assert len(topics["/tf"]) == 24
    assert [len(topics[name]) for name in ("/map/objects", "/map/markers")] == [3, 3]  # pictures 1, 11, and the last


def test_pictures_decode_with_opencv(topics):
    for (_, message), frame in zip(topics["/camera/image/compressed"], noise(12), strict=True):
        assert (message.format, message.header.frame_id) == ("jpeg", "camera_optical_frame")
        _, expected = cv2.imencode(".jpg", frame.image, [cv2.IMWRITE_JPEG_QUALITY, 90])
        assert bytes(message.data) == expected.tobytes()


def test_the_lens_projects_as_ours_does(topics):
    """OpenCV with the message's K and D against our own projection."""
    info = topics["/camera/camera_info"][0][1]
    assert (info.width, info.height, info.distortion_model) == (64, 48, "plumb_bob")
    points = np.random.default_rng(0).uniform([-0.4, -0.3, 1.0], [0.4, 0.3, 2.0], (50, 3))
    k, d = np.array(info.k).reshape(3, 3), np.array(info.d)
    pixels, _ = cv2.projectPoints(points, np.zeros(3), np.zeros(3), k, d)
    # RealSense's variant, not quite plumb_bob.
    np.testing.assert_allclose(pixels[:, 0], LENS.project(points), atol=0.01)
    np.testing.assert_array_equal(np.array(info.p).reshape(3, 4)[:, :3], k)


def test_tf_leads_from_the_map_to_the_lens(topics):
    tree = {}
    for _, message in topics["/tf"][-2:]:
        for step in message.transforms:
            t, q = step.transform.translation, step.transform.rotation
            matrix = np.eye(4)
            matrix[:3, :3] = Rotation.from_quat([q.x, q.y, q.z, q.w]).as_matrix()
            matrix[:3, 3] = t.x, t.y, t.z
            tree[step.header.frame_id, step.child_frame_id] = matrix
    assert set(tree) == {("map", "odom"), ("odom", "base_link"), ("base_link", "camera_optical_frame")}  # REP-105
    assert tree["odom", "base_link"][:2, 3] == pytest.approx([(OFF @ POSES[-1]).x_m, (OFF @ POSES[-1]).y_m])
    tree["map", "base_link"] = tree["map", "odom"] @ tree["odom", "base_link"]
    # Where a picture's ray meets the floor, by tf and by our own geometry.
    pixel = (40.0, 44.0)
    lens_map = tree["map", "base_link"] @ tree["base_link", "camera_optical_frame"]
    ray, start = lens_map[:3, :3] @ LENS.rays(pixel)[0], lens_map[:3, 3]
    floor = start + ray * (start[2] / -ray[2])
    ours = POSES[-1].apply(FloorCamera(LENS, MOUNT).floor_points(pixel)[0])
    np.testing.assert_allclose(floor, [*ours, 0.0], atol=1e-9)


def test_odometry_carries_speed_and_a_level_camera_the_usual_quaternion(topics):
    rotation = mount_transform(0, Mount(0.5))["transform"]["rotation"]
    x, y, z, w = (rotation[axis] for axis in "xyzw")
    np.testing.assert_allclose(np.array([x, y, z, w]) * np.sign(w), [-0.5, 0.5, -0.5, 0.5])
    message = topics["/odometry"][5][1]
    assert message.child_frame_id == "base_link"
    assert message.twist.covariance[0] == pytest.approx(900.0, rel=1e-4)  # 1 m² in a thirtieth of a second
    assert message.twist.twist.linear.x == pytest.approx(3.0, rel=1e-4)  # 0.1 m in a thirtieth of a second
    assert message.twist.twist.angular.z == pytest.approx(1.5, rel=1e-4)
    assert topics["/odometry"][0][1].twist.twist.linear.x == 0.0


@pytest.mark.parametrize(
    ("topic", "frame", "pose", "covariance"),
    [("/pose", "map", POSES[5], COVARIANCE), ("/odometry", "odom", OFF @ POSES[5], 2.0 * COVARIANCE)],
)
def test_poses_carry_their_covariance(topics, topic, frame, pose, covariance):
    message = topics[topic][5][1]
    assert message.header.frame_id == frame
    at = message.pose.pose
    assert (at.position.x, at.position.y, at.position.z) == (pose.x_m, pose.y_m, 0.0)
    assert 2.0 * math.atan2(at.orientation.z, at.orientation.w) == pytest.approx(pose.yaw_rad)
    full = np.array(message.pose.covariance).reshape(6, 6)
    np.testing.assert_allclose(full[np.ix_([0, 1, 5], [0, 1, 5])], covariance)


def test_boxes_and_objects(topics):
    (box,) = topics["/detections"][3][1].detections
    assert (box.bbox.center.position.x, box.bbox.center.position.y) == (25.0, 25.0)
    assert (box.bbox.size_x, box.bbox.size_y, box.id) == (10.0, 30.0, "chair-1")
    assert (box.results[0].hypothesis.class_id, box.results[0].hypothesis.score) == ("chair", 0.9)
    (item,) = topics["/map/objects"][-1][1].detections
    hypothesis = item.results[0].hypothesis
    assert (item.id, hypothesis.class_id, hypothesis.score) == ("chair-1", "chair", 0.97)
    place = item.results[0].pose
    assert (place.pose.position.x, place.pose.position.y, place.pose.orientation.w) == (2.0, -1.0, 1.0)
    np.testing.assert_allclose(np.array(place.covariance).reshape(6, 6)[:2, :2], CHAIR.covariance_m2)
    assert (item.bbox.size.x, item.bbox.size.z, item.bbox.center.position.z) == (0.5, 0.9, 0.45)


def test_markers_show_box_name_and_ellipse(topics):
    clear, box, name, ellipse = topics["/map/markers"][-1][1].markers
    assert clear.action == 3
    assert (box.type, name.type, ellipse.type) == (1, 9, 3)
    assert name.text == "chair-1"
    # The ellipse's own axes give the covariance back: R diag((axis / 2)^2 / 5.991) R'.
    yaw = 2.0 * math.atan2(ellipse.pose.orientation.z, ellipse.pose.orientation.w)
    turn = np.array([[math.cos(yaw), -math.sin(yaw)], [math.sin(yaw), math.cos(yaw)]])
    spread = np.diag([(ellipse.scale.x / 2) ** 2, (ellipse.scale.y / 2) ** 2]) / 5.991
    np.testing.assert_allclose(turn @ spread @ turn.T, CHAIR.covariance_m2, atol=1e-9)


def test_an_empty_map_clears_the_markers_and_without_lens_and_mount_there_are_no_topics_of_them(tmp_path):
    assert [marker["action"] for marker in markers(0, [])["markers"]] == [3]
    recorder = Recorder(tmp_path / "a.mcap", CameraInfo("webcam"))
    recorder.picture(noise(1)[0])
    recorder.close()
    assert set(with_rosbags(tmp_path / "a.mcap")) == {"/camera/image/compressed"}
