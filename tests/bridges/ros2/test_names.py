"""Names, types and discovery as ROS 2 has them; poses of a topic between its messages."""

import math

import pytest
from support.faults import made, texts

from edgemap.bridges.ros2.dds.discovery import Discovery, discovery_from
from edgemap.bridges.ros2.dds.types import dds_topic, dds_type, in_namespace, ros_kind
from edgemap.bridges.ros2.messages import topics
from edgemap.bridges.ros2.messages.definitions import HASHES, RosClock, definition, ros_offset_s
from edgemap.bridges.ros2.messages.topics import FrameIds
from edgemap.bridges.ros2.sink import Ros2Options
from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.errors import BridgeError, OdometryError, UsageError
from edgemap.runtime.frames.trajectory import AHEAD_S, GrowingTrack
from edgemap.runtime.motion.odometry.recorded import RecordedOdometry


def test_topics_and_types_are_mangled_as_ros_2_does():
    assert dds_topic("/tf") == "rt/tf"
    assert dds_topic(in_namespace("robot_1/", "/map/objects")) == "rt/robot_1/map/objects"
    assert in_namespace("", "/odometry") == "/odometry"
    assert dds_type("sensor_msgs/msg/CompressedImage") == "sensor_msgs::msg::dds_::CompressedImage_"
    assert ros_kind(dds_type("tf2_msgs/msg/TFMessage")) == "tf2_msgs/msg/TFMessage"


@pytest.mark.parametrize("topic", ["tf", "/", "/a//b", "/a b", "/1a", "/a__b", "/a/"])
def test_what_ros_2_refuses_is_refused(topic):
    with pytest.raises(BridgeError, match="is no ROS 2 topic"):
        dds_topic(topic)


KINDS = {topic.kind for topic in vars(topics).values() if isinstance(topic, topics.Topic)}


@pytest.mark.parametrize("kind", sorted(KINDS | {kind.replace("/", "/msg/") for kind in HASHES}))
def test_type_hashes_are_those_of_rosbags(kind):
    """From our definitions; and of Jazzy's and Lyrical's own, where rosbags has them (vision_msgs it has not)."""
    ours, typesys = f"RIHS01_{HASHES[kind.replace('/msg/', '/')]}", pytest.importorskip("rosbags.typesys")
    store = typesys.get_typestore(typesys.Stores.EMPTY)
    store.register(typesys.get_types_from_msg(definition(kind), kind))
    assert store.hash_rihs01(kind) == ours
    for distribution in ("ROS2_JAZZY", "ROS2_LYRICAL"):
        theirs = typesys.get_typestore(getattr(typesys.Stores, distribution))
        if not kind.startswith("vision_msgs/"):
            assert theirs.hash_rihs01(kind) == ours


@pytest.mark.parametrize(
    ("environment", "expected"),
    [
        ({}, Discovery(0, "this machine")),
        ({"ROS_DOMAIN_ID": "42"}, Discovery(42, "this machine")),
        ({"ROS_AUTOMATIC_DISCOVERY_RANGE": "subnet"}, Discovery(0, "SUBNET")),
        ({"ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET", "ROS_LOCALHOST_ONLY": "1"}, Discovery(0, "LOCALHOST")),
        ({"ROS_LOCALHOST_ONLY": "0"}, Discovery(0, "SUBNET")),
        ({"ROS_AUTOMATIC_DISCOVERY_RANGE": "OFF"}, Discovery(0, "OFF")),
        ({"ROS_STATIC_PEERS": "192.168.1.7;robot.local"}, Discovery(0, "this machine", ("192.168.1.7", "robot.local"))),
    ],
)
def test_discovery_follows_the_environment(environment, expected):
    assert discovery_from(environment) == expected


WRONG = ({"ROS_DOMAIN_ID": "233"}, {"ROS_DOMAIN_ID": "-1"}, {"ROS_AUTOMATIC_DISCOVERY_RANGE": "WORLD"})


@pytest.mark.parametrize("environment", [*WRONG, {"ROS_STATIC_PEERS": "<a>"}])
def test_settings_that_cannot_be_are_named(environment):
    with pytest.raises(BridgeError, match=next(iter(environment))):
        discovery_from(environment)


def test_no_other_machine_is_contacted_by_default_and_none_found_on_the_loopback_interface():
    assert "<MulticastTimeToLive>0</MulticastTimeToLive>" in Discovery().cyclone_config()
    assert '<Peer address="localhost"/>' in Discovery().cyclone_config()
    local = Discovery(range="LOCALHOST").cyclone_config()
    assert '<NetworkInterface address="127.0.0.1"/>' in local
    assert "<AllowMulticast>false</AllowMulticast>" in local
    assert "127.0.0.1" not in Discovery(range="SUBNET").cyclone_config()
    assert "localhost" not in Discovery(range="OFF").cyclone_config()
    assert Discovery(range="SYSTEM_DEFAULT").cyclone_config("<mine/>") == "<mine/>"


def test_stamps_become_ros_time_and_options_are_read():
    # A camera stamps by the wall clock, by the monotonic one, or by one of its own; a file by its own.
    assert ros_offset_s(1.7e9, 1.7e9 + 0.05, 5000.0) == 0.0
    assert ros_offset_s(4999.9, 1.7e9, 5000.0) == 1.7e9 - 5000.0
    assert ros_offset_s(3.5, 1.7e9, 5000.0) == 1.7e9 - 3.5
    options = Ros2Options.of("namespace=robot1, base=base_footprint,pictures=yes,reliable=no,odom_tf=no")
    frames = FrameIds(base="base_footprint")
    assert options == Ros2Options("robot1", frames, pictures=True, best_effort=True, odom_tf=False)
    assert Ros2Options.of("") == Ros2Options()


@pytest.mark.parametrize("stamp_s", [50.0, 3.5, 1000.0])
def test_stamps_follow_a_wall_clock_that_is_set(monkeypatch, stamp_s):
    """A robot without a clock boots in 1970; NTP sets its clock while it drives."""
    wall_s, monotonic_s, clock = 1000.0, 50.0, RosClock()
    for elapsed_s in (0.0, 0.5, 10.0, 10.1, 20.0):
        set_s = 1.76e9 if elapsed_s >= 10.0 else 0.0
        monkeypatch.setattr("time.time", lambda: wall_s + elapsed_s + set_s)  # noqa: B023
        monkeypatch.setattr("time.monotonic", lambda: monotonic_s + elapsed_s)  # noqa: B023
        published_s = stamp_s + elapsed_s + clock.offset_s(stamp_s + elapsed_s)
        assert published_s == pytest.approx(wall_s + elapsed_s + set_s)
    assert RosClock(lambda: 3.0).offset_s(5.0) == 3.0


@pytest.mark.parametrize("text", ["map", "map=", "odom=map", "base=lens,optical=lens", "map=a,map=b", "odom_tf=maybe"])
def test_a_wrong_option_of_ros2_is_refused(text):
    with pytest.raises(UsageError, match="--ros2"):
        Ros2Options.of(text)


def track(*rows: tuple[float, float]) -> GrowingTrack:
    made = GrowingTrack()
    for stamp_s, x_m in rows:
        made.push(stamp_s, SE2(x_m, 0.0, 0.0))
    return made


def test_between_two_poses_and_beyond_the_newest():
    poses = track((10.0, 1.0), (10.05, 1.02), (10.1, 1.05))
    assert poses.at(10.025).x_m == pytest.approx(1.01)
    assert poses.at(10.1).x_m == pytest.approx(1.05)
    assert poses.at(10.2).x_m == pytest.approx(1.11)  # 0.03 m in 50 ms goes on
    for stamp_s in (9.99, 10.1 + AHEAD_S + 0.01):
        with pytest.raises(OdometryError, match=r"those that came are from 10\.000 to 10\.100 s"):
            poses.at(stamp_s)


def test_a_topic_without_poses_says_nothing_and_broken_ones_are_left_out():
    with pytest.raises(OdometryError, match="no pose has come yet"):
        GrowingTrack().at(1.0)
    poses = track((1.0, 0.0), (1.2, 0.2), (1.1, 9.0), (1.2, 9.0), (math.nan, 9.0), (1.4, math.inf), (1.4, 0.4))
    assert poses.stamps_s.tolist() == [1.0, 1.2, 1.4]
    assert poses.at(1.3).x_m == pytest.approx(0.3)


def test_a_robot_that_turns_is_carried_on_along_its_arc():
    poses = GrowingTrack()
    for index in range(3):
        angle = 0.1 * index  # on a circle of 1 m
        poses.push(0.1 * index, SE2(math.sin(angle), 1.0 - math.cos(angle), angle))
    found = poses.at(0.25)
    assert found.vector() == pytest.approx([math.sin(0.25), 1.0 - math.cos(0.25), 0.25], abs=3e-3)


@pytest.mark.parametrize(("stamps", "x_m"), [((1.1, 1.2, 1.3, 1.4), 0.0), ((-50.0, -49.9, -49.8, -49.7), 50.1)])
def test_odometry_that_begins_anew_is_no_motion(stamps, x_m):
    """A driver that starts again counts from zero; a clock is set back. One step is blind, the next one moves on."""
    poses = track((0.9, 50.0), (1.0, 50.1))
    odometry = RecordedOdometry(poses, "wheels")
    odometry.step_blind(1.0, made("no picture"))
    for stamp_s, moved_m in zip(stamps[:2], (0.0, 0.1), strict=True):
        poses.push(stamp_s, SE2(x_m + moved_m, 0.0, 0.0))
    blind = odometry.step_blind(stamps[1], made("no picture"))
    assert blind.blind
    assert "began again" in texts(blind.faults)
    for stamp_s, moved_m in zip(stamps[2:], (0.2, 0.3), strict=True):
        poses.push(stamp_s, SE2(x_m + moved_m, 0.0, 0.0))
    assert odometry.step_blind(stamps[2], made("no picture")).blind
    motion = odometry.step_blind(stamps[3], made("no picture"))
    assert (motion.motion.x_m, motion.blind) == (pytest.approx(0.1), False)
