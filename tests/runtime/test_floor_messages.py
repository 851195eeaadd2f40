"""The floor as ROS 2 messages, encoded and decoded: places by hand, in a room of boxes."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from support.boxed_room import walls
from support.recordings import MOUNT
from support.seen import CAMERA
from support.steps import Steps

pytest.importorskip("mcap_ros2", reason="no mcap-ros2-support here (extra record)")


from edgemap.bridges.ros2.messages import topics
from edgemap.bridges.ros2.messages.definitions import decoder, encoder
from edgemap.bridges.ros2.messages.stream import MessageStream
from edgemap.geometry.camera.attitude import Attitude, MountEstimate

ROOM = [*walls(-1.0, -2.0, 4.0, 2.0), (2.0, -0.5, 2.5, 0.5, 0.8)]


@pytest.fixture(scope="module")
def sent():
    """All messages of five seconds at rest but for 5 cm a step: by topic."""
    steps, stream, found = Steps(boxes=ROOM), MessageStream(), {}
    for _ in range(31):
        result, objects = steps.next()
        for outgoing in stream.results(result, objects):
            message = decoder(outgoing.topic.kind)(encoder(outgoing.topic.kind)(outgoing.make()))
            found.setdefault(outgoing.topic, []).append((outgoing.stamp_ns, message))
    return found


def test_the_map_changes_once_a_second_and_holds_floor_and_obstacles_in_their_places(sent):
    stamps = [stamp / 1e9 for stamp, _ in sent[topics.MAP]]
    assert np.diff(stamps) == pytest.approx([1.0] * (len(stamps) - 1))
    grid = sent[topics.MAP][-1][1]
    info, corner = grid.info, grid.info.origin.position
    cells = np.frombuffer(bytes(value % 256 for value in grid.data), np.int8).reshape(info.height, info.width)

    def at(x_m, y_m):
        column, row = (int((value - low) / info.resolution) for value, low in ((x_m, corner.x), (y_m, corner.y)))
        return cells[row, column]

    assert grid.header.frame_id == "map"
    assert info.resolution == pytest.approx(0.05)
    assert at(1.0, 0.0) == 0
    assert at(2.25, 0.0) == -1
    assert 100 in {at(1.975, y) for y in (-0.2, 0.0, 0.2)} | {at(2.025, y) for y in (-0.2, 0.0, 0.2)}


def test_a_scan_has_the_box_where_it_stands_and_nothing_where_no_contact_is(sent):
    """From 5 cm ahead of the start the box's front is 1.95 m away, straight ahead."""
    scan = sent[topics.FLOOR_SCAN][1][1]
    assert scan.header.frame_id == "base_link"
    angles = scan.angle_min + scan.angle_increment * np.arange(len(scan.ranges))
    pose_m = sent[topics.FLOOR_SCAN][1][0] / 1e9 * 0.5
    ahead = np.abs(angles) < math.radians(10)
    x_m = np.array(scan.ranges)[ahead] * np.cos(angles[ahead])
    assert np.nanmedian(x_m) == pytest.approx(2.0 - pose_m, abs=0.06)
    finite = np.array(scan.ranges)[np.isfinite(scan.ranges)]
    assert ((finite > scan.range_min) & (finite < scan.range_max)).all()
    assert np.isnan(scan.ranges).any()


def test_a_bundle_without_a_floor_head_sends_neither():
    steps, stream = Steps(), MessageStream()
    topics_sent = {outgoing.topic for _ in range(12) for outgoing in stream.results(*steps.next())}
    assert topics.OBJECTS in topics_sent
    assert not {topics.MAP, topics.FLOOR_SCAN} & topics_sent


@pytest.mark.parametrize("static", [False, True])
def test_the_lens_is_where_the_mount_in_use_has_it(static):
    """The corrected pitch of a step holds from the next picture on; on /tf_static it is sent once."""
    steps, stream, sent = Steps(boxes=ROOM), MessageStream(mount=MOUNT, static_mount=static), []
    corrected = replace(MOUNT, pitch_rad=MOUNT.pitch_rad + 0.1)
    for index in range(6):
        result, objects = steps.next()
        sent.append([outgoing for outgoing in stream.picture(result.frame) if outgoing.topic.startswith("/tf")])
        attitude = Attitude.of_mount(MOUNT)
        if index >= 3:
            attitude = replace(attitude, mount=MountEstimate(corrected, np.full(2, 0.01), corrected, MOUNT))
        camera = replace(CAMERA, mount=MOUNT).at(attitude)
        list(stream.results(replace(result, observed=replace(result.observed, camera=camera)), objects))
    assert [len(some) for some in sent] == ([1, 0, 0, 0, 1, 0] if static else [1] * 6)
    (first,), (turned,) = (sent[index][0].make()["transforms"] for index in (0, 4))
    assert turned["transform"]["translation"] == first["transform"]["translation"]
    before, after = (Rotation.from_quat([*one["transform"]["rotation"].values()]) for one in (first, turned))
    assert (after * before.inv()).magnitude() == pytest.approx(0.1)
