"""RealSense through librealsense's own recorder and playback: nothing is faked but the lens in front. Hardware resets a
recording cannot prove."""

import os
import subprocess
import sys
import textwrap
import threading
from typing import Any

import numpy as np
import pytest
from support import live_camera
from support.realsense_playback import Playback
from support.recordings import drain
from support.refusal import refused

from edgemap.runtime.frames.camera import CameraOptions, RecoveryRule
from edgemap.runtime.frames.errors import CameraError
from edgemap.runtime.inputs.cameras import realsense_frames
from edgemap.runtime.inputs.cameras.live import LiveCamera
from edgemap.runtime.inputs.open import open_camera

rs: Any = pytest.importorskip("pyrealsense2")

from reliability.record_realsense import record_realsense  # noqa: E402

LENS = (615.2, 615.4, 321.1, 239.7)


def test_every_frame_comes_back_bit_exact_in_order(realsense_recording):
    path, pictures, stamps = realsense_recording
    with open_camera(f"realsense:{path}") as camera:
        assert not camera.info.live
        assert camera.info.size == (640, 480)
        assert camera.info.rate_hz == 30.0
        lens = camera.info.intrinsics
        frames = drain(camera)
        assert camera.read() is None
    assert (lens.fx, lens.fy, lens.cx, lens.cy) == LENS
    assert lens.distortion.is_identity
    assert [frame.index for frame in frames] == list(range(60))
    assert all(frame.depth is None for frame in frames)
    np.testing.assert_allclose([frame.stamp_s for frame in frames], stamps, atol=1e-6)
    for frame, picture in zip(frames, pictures, strict=True):
        np.testing.assert_array_equal(frame.image[..., ::-1], picture)


def test_distortion_is_carried_over(tmp_path):
    coefficients = (-0.055, 0.064, 0.0009, -0.0006, -0.021)
    picture = np.zeros((480, 640, 3), np.uint8)
    path = record_realsense(tmp_path / "d.db3", [picture] * 3, [0.0, 0.1, 0.2], coefficients=coefficients)
    with open_camera(f"realsense:{path}") as camera:
        assert camera.info.intrinsics.distortion.model == "inverse_brown_conrady"
        assert camera.info.intrinsics.distortion.coefficients == coefficients


def test_a_lens_that_is_not_brown_conrady_is_refused(tmp_path):
    picture = np.zeros((480, 640, 3), np.uint8)
    model, coefficients = rs.distortion.kannala_brandt4, (0.1, 0.0, 0.0, 0.0, 0.0)
    path = record_realsense(tmp_path / "f.db3", [picture] * 2, [0.0, 0.1], model=model, coefficients=coefficients)
    with pytest.raises(CameraError, match=r"kannala_brandt4 with coefficients \[0.1, .* not supported"):
        open_camera(f"realsense:{path}")


def test_yuyv_recordings_are_converted(tmp_path):
    flat = np.full((480, 640, 3), (40, 120, 200), np.uint8)  # BGR
    packed = np.empty((480, 640, 2), np.uint8)  # BT.601, limited range, from the numbers above by hand
    packed[..., 0] = round(16 + 0.257 * 200 + 0.504 * 120 + 0.098 * 40)
    packed[:, 0::2, 1] = round(128 - 0.148 * 200 - 0.291 * 120 + 0.439 * 40)
    packed[:, 1::2, 1] = round(128 + 0.439 * 200 - 0.368 * 120 - 0.071 * 40)
    path = record_realsense(tmp_path / "y.db3", [packed], [5.0], stream_format=rs.format.yuyv)
    with open_camera(f"realsense:{path}") as camera:
        assert np.abs(camera.read().image.astype(int) - flat).max() <= 3


def test_no_device_and_no_recording_are_one_line(tmp_path):
    if not rs.context().query_devices().size():
        with pytest.raises(CameraError, match=r"^no RealSense device found .*cable.*udev"):
            open_camera("realsense")
    for name in ("x.db3", "x.bag"):  # both are librealsense's
        spec = f"realsense:{tmp_path / name}"
        assert "no such file" in refused(CameraError, open_camera, spec)
        (tmp_path / name).write_bytes(b"no database")
        assert f"{name}: not a RealSense recording" in refused(CameraError, open_camera, spec)


LACKS_USB = "libusb-1.0.so.0: cannot open shared object file: No such file or directory"
LACKS_ALL = "No module named 'pyrealsense2'"


@pytest.mark.parametrize(("complaint", "remedy"), [(LACKS_USB, "apt install libusb-1.0-0"), (LACKS_ALL, "[realsense]")])
def test_a_missing_library_names_its_remedy(complaint, remedy):
    program = textwrap.dedent(f"""
        import sys
        class Block:
            def find_spec(self, name, path=None, target=None):
                if name.partition(".")[0] == "pyrealsense2":
                    raise ImportError({complaint!r})
        sys.meta_path.insert(0, Block())
        from edgemap.geometry.errors import EdgemapError
        from edgemap.runtime.inputs.open import open_camera
        try:
            open_camera("realsense")
        except EdgemapError as error:
            print(error)
    """)
    run = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, env=dict(os.environ))
    assert run.returncode == 0, run.stderr
    assert remedy in run.stdout
    assert run.stdout.count("\n") == 1


@pytest.mark.parametrize(("reads", "times"), [(0, 5), (1, 5), (5, 5), (100, 1)])
def test_the_thread_that_reads_a_recording_is_done_when_it_is_closed(realsense_recording, reads, times, monkeypatch):
    """Else it would go on with a playback that is let go of, which ends the process."""
    begun, begin = [], realsense_frames.await_begin
    monkeypatch.setattr(realsense_frames, "await_begin", lambda *given: begin(*given) or begun.append(given[1]))
    for _ in range(times):
        camera = open_camera(f"realsense:{realsense_recording[0]}")
        assert begun[-1].current_status() != rs.playback_status.stopped  # begun, not yet at its end
        for _ in range(reads):
            camera.read()
        camera.close()
        assert begun[-1].current_status() == rs.playback_status.stopped


@pytest.mark.parametrize("room", ["recorded_motion", "depth_beside"])
def test_what_librealsense_says_of_damaged_motion_or_depth_is_one_line(realsense_recording, monkeypatch, room):
    """No recording of ours makes it fail there, so it is made to; the pictures' playback is let go of as ever."""

    def fails(*_):
        raise RuntimeError("Failed to read\nthe file")

    monkeypatch.setattr(f"edgemap.runtime.inputs.cameras.realsense_recording.{room}", fails)
    with pytest.raises(CameraError, match=r"drive\.db3: motion or depth in it is damaged \(Failed to read the file\)"):
        open_camera(f"realsense:{realsense_recording[0]}")


def test_a_stream_that_ends_is_late_and_then_opened_again(realsense_recording):
    path, pictures, _ = realsense_recording
    driver, faults = Playback(path), []
    with LiveCamera(driver, CameraOptions(recovery=RecoveryRule(stall_limit_s=0.4))) as camera:
        assert (camera.info.live, camera.info.size, camera.info.rate_hz) == (True, (640, 480), 30.0)
        assert camera.info.intrinsics.fx == 615.2
        driver.broken = 1
        frames = live_camera.drain(camera, len(pictures) + 5, faults)
    kinds = [fault.kind.value for fault in faults]  # on a busy machine it is late before that, too
    ended = kinds.index("closed")
    assert "late" in kinds[:ended]
    assert "recovered" in kinds[ended:]
    stamps = np.diff([frame.stamp_s for frame in frames])
    assert (stamps > 0).all()  # the second playback's stamps begin again, the stream's do not
    assert any((frames[0].image[..., ::-1] == picture).all() for picture in pictures)


def test_librealsenses_device_change_callback_says_what_came(realsense_recording):
    # That something went, librealsense does not say of recordings.
    path, _, _ = realsense_recording
    driver, told, changed = Playback(path), [], threading.Event()

    def tell(present):
        told.append(present)
        changed.set()

    driver.watch(tell)
    driver.plug_in()
    assert changed.wait(5.0)
    assert told == [True]
