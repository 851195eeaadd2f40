"""Depth and inertial samples that come with the pictures."""

import math
from typing import Any

import cv2
import numpy as np
import pytest
from support import recordings
from support.depth_room import depth_room, record_depth
from support.live_camera import Clock, ScriptedDriver, drain, picture
from support.made_camera import MadeCamera
from support.realsense_playback import Playback

from edgemap.geometry.camera.intrinsics import Intrinsics
from edgemap.geometry.camera.mount import Mount
from edgemap.runtime.frames.camera import CameraOptions
from edgemap.runtime.inputs.cameras.imu_buffer import ImuBuffer, ImuCamera
from edgemap.runtime.inputs.cameras.live import LiveCamera
from edgemap.runtime.inputs.open import open_camera


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    pytest.importorskip("pyrealsense2")
    rooms = [depth_room(Mount.from_degrees(0.62, pitch)) for pitch in np.linspace(15.0, 19.0, 9)]
    return record_depth(tmp_path_factory.mktemp("depth") / "depth.db3", rooms), rooms


def shows(depth, room):
    """But for an edge here and there, which librealsense's alignment moves by a pixel; in millimetres in between."""
    return np.quantile(np.abs(depth - room), 0.9) < 0.0006


def test_a_recorded_depth_stream_comes_with_its_pictures(recording):
    path, rooms = recording
    with open_camera(f"realsense:{path}") as camera:
        frames = recordings.drain(camera)
    with open_camera(f"realsense:{path}", CameraOptions(depth=False)) as camera:
        plain = recordings.drain(camera)
    assert len(frames) == len(plain) == len(rooms)
    assert [frame.stamp_s for frame in frames] == [frame.stamp_s for frame in plain]
    assert all(frame.depth is None for frame in plain)
    found = [(index, frame.depth) for index, frame in enumerate(frames) if frame.depth is not None]
    assert len(found) >= len(rooms) - 2  # librealsense may match a picture at either end with nothing
    for index, depth in found:
        assert shows(depth, rooms[index])


def test_a_live_device_brings_depth_beside_its_pictures(recording):
    path, rooms = recording
    with LiveCamera(Playback(path)) as camera:
        frames = drain(camera, 3)
    depths = [frame.depth for frame in frames if frame.depth is not None]
    assert depths
    assert all(any(shows(depth, room) for room in rooms) for depth in depths)


def test_a_drive_brings_its_depth_and_goes_on_past_what_is_damaged(tmp_path):
    (tmp_path / "images").mkdir()
    (tmp_path / "depth").mkdir()
    depths = [np.full((480, 640), 1000 + index, np.uint16) for index in range(4)]
    for index, depth in enumerate(depths):
        cv2.imwrite(str(tmp_path / f"images/{index}.png"), np.full((480, 640, 3), 40 * index, np.uint8))
        cv2.imwrite(str(tmp_path / f"depth/{index}.png"), depth)
    damaged = tmp_path / "depth/1.png"
    damaged.write_bytes(damaged.read_bytes()[:60])
    cv2.imwrite(str(tmp_path / "depth/2.png"), np.ones((240, 320), np.uint16))
    lens = "{width: 640, height: 480, fx: 615.2, fy: 615.4, cx: 321.1, cy: 239.7, fps: 10, world_up: z, "
    (tmp_path / "camera.yaml").write_text(lens + "mount: {height_m: 0.62, pitch_deg: 17}}\n")
    poses = "".join(f"{index / 10} {index / 10} 0 0 0 0 0 1\n" for index in range(4))
    (tmp_path / "poses.tum").write_text(poses)
    with open_camera(f"drive:{tmp_path}") as camera:
        frames = recordings.drain(camera)
    assert [frame.depth is not None for frame in frames] == [True, False, False, True]
    assert frames[3].depth[0, 0] == np.float32(1.003)
    with open_camera(f"drive:{tmp_path}", CameraOptions(depth=False)) as camera:
        assert [frame.depth for frame in recordings.drain(camera)] == [None] * 4


@pytest.mark.parametrize("kind", ["c2w", "drive"])
def test_depth_of_a_camera_beside_the_lens_is_registered_to_the_picture(tmp_path, kind):
    """A wall 2 m ahead whose left half is unknown: 0.1 m beside it is 4 px off, and 10 mm nearer as the lens is ahead;
    a depth picture of another size is left out."""
    folder = tmp_path / kind
    images = folder / ("images" if kind == "drive" else "image")
    for path in (images, folder / "depth"):
        path.mkdir(parents=True)
    wall = np.full((60, 80), 2000, dtype=np.uint16)
    wall[:, :40] = 0
    for index, depth in enumerate((wall, wall[:30])):
        cv2.imwrite(str(images / f"{index}.png"), np.full((60, 80, 3), 90, np.uint8))
        cv2.imwrite(str(folder / "depth" / f"{index}.png"), depth)
    lens = "width: 80, height: 60, fx: 80.0, fy: 80.0, cx: 39.5, cy: 29.5"
    mount = "mount: {height_m: 0.6, pitch_deg: 10.0}"
    (folder / "camera.yaml").write_text(f"{{{lens}, {mount}, depth: {{{lens}, position_m: [-0.1, 0, -0.01]}}}}")
    if kind == "drive":
        (folder / "poses.tum").write_text("0 0 0 0 0 0 0 1\n0.1 0 0 0 0 0 0 1\n")
    else:
        level = "0 0 1 0 -1 0 0 0 0 -1 0 0 0 0 0 1\n"
        (folder / "poses.txt").write_text(2 * level)
    with open_camera(f"{kind}:{folder}") as camera:
        first, second = recordings.drain(camera)
    expected = np.zeros((60, 80), np.float32)
    expected[:, 36:76] = 1.99
    np.testing.assert_allclose(first.depth, expected, atol=1e-6)
    assert second.depth is None


def test_samples_pushed_by_a_program_come_with_the_frames_once_each():
    buffer = ImuBuffer(rotation=np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]]))  # base axes
    lens = Intrinsics(8, 6, 8.0, 8.0, 3.5, 2.5)
    still = MadeCamera(math.inf, lambda _: np.zeros((6, 8, 3), np.uint8), start_s=0.1, intrinsics=lens)
    camera = ImuCamera(still, buffer)
    for stamp_s in (0.05, 0.10, 0.15):
        buffer.push(stamp_s, (0.0, 0.0, 1.0), (0.0, 0.0, 9.8))
    buffer.push(0.12, (0.0, 0.0, float("nan")), (0.0, 0.0, 9.8))
    first, second = camera.read(), camera.read()
    assert first.imu.stamps_s.tolist() == [0.05, 0.10]
    assert second.imu.stamps_s.tolist() == [0.15]
    np.testing.assert_allclose(second.imu.gyro_rad_s, [[0.0, -1.0, 0.0]])  # up is minus y in a camera
    np.testing.assert_allclose(second.imu.accel_m_s2, [[0.0, -9.8, 0.0]])


def test_an_accelerometer_at_its_own_rate_is_interpolated():
    buffer = ImuBuffer()
    for stamp_s, value in ((0.0, 0.0), (0.1, 1.0)):
        buffer.push_force(stamp_s, (value, 0.0, 0.0))
    for stamp_s in (0.02, 0.05):
        buffer.push_rate(stamp_s, (0.0, 0.0, 0.0))
    np.testing.assert_allclose(buffer.take(0.06).accel_m_s2[:, 0], [0.2, 0.5])


@pytest.mark.parametrize("by_s", [-3600.0, -0.3, 5.0])
def test_a_device_clock_that_jumps_shifts_samples_and_pictures_alike(by_s):
    clock = Clock()
    buffer = ImuBuffer(clock_s=clock)

    class Jumping(ScriptedDriver):
        def grab(self):
            self.clock.now_s += 0.001  # as late as the samples are
            for _ in range(20):
                clock.now_s += 0.005
                device_s = clock() - 900.0 + (by_s if clock() > 1002.03 else 0.0)
                buffer.push(device_s, (0.0, 0.0, 0.1), (0.0, 9.8, 0.0))
            number, self.grabs = self.grabs, self.grabs + 1
            return device_s, picture(number)

    driver: Any = Jumping(clock)
    frames = drain(ImuCamera(LiveCamera(driver, clock_s=clock, wait=clock.wait), buffer), 60)
    stamps = np.array([frame.stamp_s for frame in frames])
    np.testing.assert_allclose(np.diff(stamps), 0.101, atol=2e-3)
    assert {len(frame.imu) for frame in frames[1:]} <= {19, 20, 21}
    samples = np.concatenate([frame.imu.stamps_s for frame in frames])
    assert len(samples) == 60 * 20
    assert (np.diff(samples) > 0).all()
    assert max(abs(frame.imu.stamps_s[-1] - frame.stamp_s) for frame in frames) < 0.01


def test_a_realsense_recording_brings_all_of_its_samples(tmp_path):
    pytest.importorskip("pyrealsense2")
    from reliability.record_realsense import record_motion

    with open_camera(f"realsense:{record_motion(tmp_path / 'motion.db3')}") as camera:
        frames = list(iter(camera.read, None))
    assert len(frames) == 29
    assert len(camera.info.imu) == 200
    # The last picture is taken with sample 196; each of the others brings the seven since the one before.
    assert [len(frame.imu) for frame in frames] == [1] + [7] * 28
    np.testing.assert_allclose(frames[1].imu.gyro_rad_s[0], [0.1, 0.2, 0.001], atol=1e-7)
    np.testing.assert_allclose(frames[1].imu.accel_m_s2[0], [0.0, -9.8, 1.0], atol=1e-6)


def test_a_realsense_recording_whose_motion_takes_too_long_to_read_says_so(tmp_path, monkeypatch):
    pytest.importorskip("pyrealsense2")
    from reliability.record_realsense import record_motion

    monkeypatch.setattr("edgemap.runtime.inputs.cameras.realsense_frames.PLAYBACK_LIMIT_S", 0.0)
    with open_camera(f"realsense:{record_motion(tmp_path / 'motion.db3')}") as camera:
        (fault,) = camera.info.faults
    assert "motion.db3: its motion is not read whole within 0 s" in fault.text
