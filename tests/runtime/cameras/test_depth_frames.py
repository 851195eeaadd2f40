"""Depth beside the pictures: recorded and live RealSense through librealsense's software device, and drives on disk."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from support import recordings
from support.depth_room import depth_room, record_depth
from support.live_camera import drain
from support.realsense_playback import Playback

from edgemap.geometry.camera.mount import Mount
from edgemap.runtime.inputs.cameras.live import LiveCamera
from edgemap.runtime.inputs.open import open_camera

MOUNT = Mount.from_degrees(0.62, 17.0)


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
    with open_camera(f"realsense:{path}", depth=False) as camera:
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


def test_a_recording_without_depth_brings_none(realsense_recording):
    path, pictures, _ = realsense_recording
    with open_camera(f"realsense:{path}") as camera:
        frames = recordings.drain(camera)
    assert len(frames) == len(pictures)
    assert all(frame.depth is None for frame in frames)


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
    _camera_file(tmp_path)
    poses = "".join(f"{index / 10} {index / 10} 0 0 0 0 0 1\n" for index in range(4))
    (tmp_path / "poses.tum").write_text(poses)
    with open_camera(f"drive:{tmp_path}") as camera:
        frames = recordings.drain(camera)
    assert [frame.depth is not None for frame in frames] == [True, False, False, True]
    assert frames[3].depth is not None
    assert frames[3].depth[0, 0] == np.float32(1.003)
    with open_camera(f"drive:{tmp_path}", depth=False) as camera:
        assert [frame.depth for frame in recordings.drain(camera)] == [None] * 4


def _camera_file(folder: Path) -> None:
    lens = "{width: 640, height: 480, fx: 615.2, fy: 615.4, cx: 321.1, cy: 239.7, fps: 10, world_up: z, "
    (folder / "camera.yaml").write_text(lens + "mount: {height_m: 0.62, pitch_deg: 17}}\n")
