"""Videos that break in the middle or change their size: the run goes on to a map or ends with one line."""

import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from edgemap.runtime.frames.errors import CameraError, CameraFault
from edgemap.runtime.inputs.cameras.pictures import VideoCamera
from edgemap.runtime.inputs.open import DEMO

READ = """
import sys
from pathlib import Path
sys.path.insert(0, sys.argv[2])
from test_broken_videos import read_all
sizes, _, end = read_all(Path(sys.argv[1]))
assert len(set(sizes)) <= 1
assert "\\n" not in end
"""


def jpeg(size, level):
    image = np.random.default_rng(level).integers(0, 255, (size[1], size[0], 3), np.uint8)
    return cv2.imencode(".jpg", image)[1].tobytes()


def read_all(path):
    """Frames, and how it ended."""
    sizes, faults = [], 0
    with VideoCamera("video", path) as camera:
        for _ in range(10_000):
            try:
                frame = camera.read()
            except CameraFault:
                faults += 1
                continue
            except CameraError as error:
                return sizes, faults, str(error)
            if frame is None:
                break
            sizes.append(frame.image.shape[:2])
    return sizes, faults, ""


def test_a_video_that_changes_its_size_delivers_one_size_or_says_so(tmp_path):
    path = tmp_path / "changing.mjpeg"
    path.write_bytes(b"".join([jpeg((64, 48), k) for k in range(5)] + [jpeg((128, 96), k) for k in range(5, 10)]))
    sizes, _, end = read_all(path)
    assert set(sizes) == {(48, 64)}
    assert "\n" not in end


@pytest.mark.parametrize("seed", range(6))
def test_a_video_with_a_broken_middle_ends_in_order(tmp_path, seed):
    random = np.random.default_rng(seed)
    data = bytearray(next(DEMO.glob("*.mp4")).read_bytes())
    start = int(random.integers(len(data) // 4, len(data) // 2))
    data[start : start + 20_000] = random.bytes(20_000)
    path = tmp_path / "broken.mp4"
    path.write_bytes(data)
    command = [sys.executable, "-c", READ, str(path), str(Path(__file__).parent)]  # what ends the process ends this one
    ended = subprocess.run(command, capture_output=True, text=True, timeout=120)
    assert ended.returncode == 0, ended.stderr[-500:]
