"""What was recorded comes back: pictures, stamps, lens, mount, wheels, truth; and what a cut or a kill leaves."""

import signal
import subprocess
import sys
import textwrap
import tracemalloc
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mcap.reader import make_reader
from support.recordings import FACTS, LENS, MOUNT, drain, noise, record

from edgemap.bridges.ros2.messages.definitions import to_ns, to_s
from edgemap.bridges.ros2.messages.topics import WHEEL
from edgemap.bridges.ros2.recordings import recorder as recorder_module
from edgemap.bridges.ros2.recordings.facts import facts_record, read_facts
from edgemap.bridges.ros2.recordings.foreign import read_wheel
from edgemap.bridges.ros2.recordings.pictures import encoded_depth
from edgemap.bridges.ros2.recordings.recorder import Recorder
from edgemap.geometry.camera.imu import ImuSamples
from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.camera import Camera, CameraOptions
from edgemap.runtime.frames.errors import BridgeError, CameraError
from edgemap.runtime.frames.frame import Frame
from edgemap.runtime.frames.inference import Inference
from edgemap.runtime.frames.trajectory import Trajectory
from edgemap.runtime.inputs.open import open_camera

TESTS = Path(__file__).parents[2]


def test_lossless_gives_back_every_bit(tmp_path):
    frames = noise(30)
    with open_camera(str(record(tmp_path / "a.mcap", FACTS, frames, lossless=True))) as camera:
        assert isinstance(camera, Camera)
        info = camera.info
        assert (info.live, info.size, info.frame_count, info.rate_hz) == (False, (64, 48), 30, 10.0)
        assert (info.intrinsics, info.mount) == (LENS, MOUNT)
        played = drain(camera)
        assert camera.read() is None
    assert [frame.index for frame in played] == list(range(30))
    assert [frame.stamp_s for frame in played] == [frame.stamp_s for frame in frames]
    for got, was in zip(played, frames, strict=True):
        np.testing.assert_array_equal(got.image, was.image)


def test_what_a_run_decided_comes_back_and_an_older_recording_has_none(tmp_path):
    decided = Inference("openvino", "int8")
    for name, facts in (("a.mcap", replace(FACTS, inference=decided)), ("b.mcap", FACTS)):
        with open_camera(str(record(tmp_path / name, facts, noise(2)))) as camera:
            assert camera.info.inference == facts.inference
    with pytest.raises(CameraError, match=r"inference: Invalid enum value 'abacus'"):
        read_facts(facts_record(FACTS) | {"inference": '{"engine": "abacus", "precision": "int8"}'}, "a.mcap")
    older = facts_record(FACTS)
    del older["inference"]
    assert read_facts(older, "a.mcap").inference is None


@given(st.floats(0.0, 2.0**31 - 1))
def test_stamps_are_the_nearest_nanosecond(stamp_s):
    assert abs(to_s(to_ns(stamp_s)) - stamp_s) <= 0.5e-9 + np.spacing(stamp_s)
    if stamp_s >= 2.0**23:
        assert to_s(to_ns(stamp_s)) == stamp_s


@given(st.integers(0, 2**31 * 10**9 - 10**9))
def test_whole_nanoseconds_stay(stamp_ns):
    assert to_s(stamp_ns) == float(f"{stamp_ns // 10**9}.{stamp_ns % 10**9:09d}")


def test_stamps_finer_than_a_nanosecond_come_back_too(tmp_path):
    picture = np.zeros((48, 64, 3), np.uint8)
    stamps = [i * 1001 / 30000 for i in range(5)]  # 29.97 Hz
    assert any(to_s(to_ns(stamp)) != stamp for stamp in stamps)
    for count in (5, 1):  # one alone, at zero, has a stamp too
        frames = [Frame(i, stamp, picture) for i, stamp in enumerate(stamps[:count])]
        with open_camera(str(record(tmp_path / f"{count}.mcap", FACTS, frames))) as camera:
            assert [frame.stamp_s for frame in drain(camera)] == stamps[:count]


@pytest.mark.parametrize("stamp_s", [-0.1, 2.0**31, float("nan")])
def test_a_stamp_that_ros_cannot_hold_is_refused(tmp_path, stamp_s):
    frame = Frame(0, stamp_s, np.zeros((48, 64, 3), np.uint8))
    with pytest.raises(BridgeError, match="cannot be recorded"):
        record(tmp_path / "a.mcap", FACTS, [frame])


def test_wheels_and_truth_come_back_bit_for_bit(tmp_path):
    random = np.random.default_rng(3)
    frames = noise(5)
    stamps = frames[0].stamp_s + np.arange(20) / 50
    ways = [Trajectory(stamps, tuple(SE2(*row) for row in random.normal(size=(20, 3)))) for _ in range(2)]
    path = record(tmp_path / "a.mcap", FACTS, frames, wheel=ways[0], truth=ways[1])
    with open_camera(str(path)) as camera:
        assert camera.info.truth.poses == ways[1].poses
        np.testing.assert_array_equal(camera.info.truth.stamps_s, stamps)
        assert camera.info.wheel.poses == ways[0].poses
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(path.read_bytes()[:-8])  # without its end
    with open_camera(str(cut)) as camera:
        assert camera.info.wheel.poses == ways[0].poses
    with open_camera(str(record(tmp_path / "none.mcap", FACTS, frames))) as camera:
        assert camera.info.wheel is None
    # The messages hold what the wheels had done when the last picture came, at 4/30 s: seven poses of fifty a second.
    replayed = read_wheel(f"{path}#/wheel/odometry")
    assert len(replayed.poses) == 7
    for got, was in zip(replayed.poses, ways[0].poses, strict=False):
        np.testing.assert_allclose([got.x_m, got.y_m, got.yaw_rad], [was.x_m, was.y_m, was.yaw_rad], atol=1e-12)


def test_wheels_that_rolled_before_a_stream_that_starts_at_zero_are_recorded(tmp_path):
    frames = [replace(frame, stamp_s=frame.index / 10) for frame in noise(3)]
    way = Trajectory(np.array([-0.2, -0.1, 0.0, 0.1, 0.2]), tuple(SE2(0.1 * index) for index in range(5)))
    path = record(tmp_path / "a.mcap", FACTS, frames, wheel=way)
    assert read_wheel(str(path)).poses == way.poses
    assert len(read_wheel(f"{path}#/wheel/odometry").poses) == 3  # ROS time has none below zero


def test_given_lens_and_mount_go_first_and_another_size_is_refused(tmp_path):
    path = str(record(tmp_path / "a.mcap", FACTS, noise(2)))
    lens, mount = replace(LENS, fx=70.0), replace(MOUNT, height_m=1.0)
    with open_camera(path, CameraOptions(intrinsics=lens, mount=mount)) as camera:
        assert (camera.info.intrinsics, camera.info.mount) == (lens, mount)
    options = CameraOptions(intrinsics=replace(LENS, width=32))
    refusal = "picture is 64x48, the intrinsics are for 32x48"
    with open_camera(path, options) as camera, pytest.raises(CameraError, match=refusal):
        camera.read()


def test_nothing_is_written_over_and_a_flipped_bit_is_noticed(tmp_path):
    path = record(tmp_path / "a.mcap", FACTS, noise(2))
    before = path.read_bytes()
    with pytest.raises(BridgeError, match=r"a\.mcap exists already"):
        record(path, FACTS, noise(2))
    assert path.read_bytes() == before
    path = record(tmp_path / "b.mcap", FACTS, noise(200), lossless=True)
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 1
    path.write_bytes(data)
    with open_camera(str(path)) as camera, pytest.raises(CameraError, match=r"damaged recording.*crc"):
        drain(camera)


def test_a_killed_recording_still_opens(tmp_path):
    program = textwrap.dedent(f"""
        import os, signal
        from support.recordings import FACTS, noise
        from pathlib import Path
        from edgemap.bridges.ros2.recordings.recorder import Recorder
        recorder = Recorder(Path({str(tmp_path / "a.mcap")!r}), FACTS, lossless=True)
        for frame in noise(200):
            recorder.picture(frame)
        os.kill(os.getpid(), signal.SIGKILL)
    """)
    killed = subprocess.run([sys.executable, "-c", program], cwd=TESTS, check=False)
    assert killed.returncode == -signal.SIGKILL
    frames = noise(200)
    with open_camera(str(tmp_path / "a.mcap")) as camera:
        assert (camera.info.intrinsics, camera.info.mount, camera.info.rate_hz) == (LENS, MOUNT, 10.0)
        played = []
        with pytest.raises(CameraError, match=r"a\.mcap: cut off, the \d+ complete pictures before it were read"):  # noqa: PT012
            while True:
                played.append(camera.read())
        assert camera.info.frame_count == len(played)
    # A picture takes 9 kB: half a MiB, which the file lags behind at most, holds fewer than 60.
    assert 140 < len(played) < 200
    for got, was in zip(played, frames, strict=False):
        assert got.stamp_s == was.stamp_s
        np.testing.assert_array_equal(got.image, was.image)


def test_a_recording_cut_off_is_read_to_its_last_complete_chunk(tmp_path):
    """Colour, depth and wheels are read in turn from a file without an index, of several chunks."""
    depth = np.random.default_rng(1).integers(0, 60_000, (48, 64)).astype(np.float32) / np.float32(1000)
    frames = [replace(frame, depth=depth) for frame in noise(150)]
    wheel = Trajectory(np.array([frame.stamp_s for frame in frames]), tuple(SE2(i / 30, 0.1, 0.2) for i in range(150)))
    path = record(tmp_path / "a.mcap", FACTS, frames, lossless=True, wheel=wheel)
    whole = path.read_bytes()
    with path.open("rb") as stream:
        indexes = make_reader(stream).get_summary().chunk_indexes
    last_ns = [index.message_end_time for index in indexes]
    end = indexes[-1].chunk_start_offset + indexes[-1].chunk_length
    for cut, newest_ns in ((len(whole) - 8, last_ns[-1]), (end - 1, last_ns[-2])):
        path.write_bytes(whole[:cut])
        expected = [frame for frame in frames if to_ns(frame.stamp_s) <= newest_ns]
        with open_camera(str(path)) as camera:
            played = [camera.read() for _ in range(camera.info.frame_count)]
            with pytest.raises(CameraError, match=f"cut off, the {len(played)} complete pictures"):
                camera.read()
        assert len(expected) - len(played) in (0, 1)  # a chunk may end between a picture and what belongs to it
        for got, was in zip(played, frames, strict=False):
            assert got.stamp_s == was.stamp_s
            np.testing.assert_array_equal(got.image, was.image)
            np.testing.assert_array_equal(got.depth, depth)
        rolled = read_wheel(f"{path}#{WHEEL}")
        assert rolled.poses[-1].x_m == pytest.approx((len(expected) - 1) / 30)
        assert read_wheel(str(path)).poses == wheel.poses  # the attachment stands before the first chunk


@pytest.mark.parametrize("content", [b"", b"no recording", b"\x89MCAP0\r\n"])
def test_what_is_no_recording_is_one_line(tmp_path, content):
    (tmp_path / "a.mcap").write_bytes(content)
    with pytest.raises(CameraError, match=r"a\.mcap: (not an MCAP recording \(\d+ bytes\)|no topic with)") as caught:
        open_camera(str(tmp_path / "a.mcap"))
    assert "\n" not in str(caught.value)
    with pytest.raises(CameraError, match="no such file"):
        open_camera(str(tmp_path / "b.mcap"))


def test_recording_takes_no_memory_with_time(tmp_path):
    recorder = Recorder(tmp_path / "a.mcap", FACTS, lossless=True)
    frames = noise(100)
    tracemalloc.start()
    for again in range(4):
        for frame in frames:
            recorder.picture(Frame(0, frame.stamp_s + 100 * again, frame.image))
        if again == 0:
            first = tracemalloc.get_traced_memory()[0]
    last, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    recorder.close()
    assert (tmp_path / "a.mcap").stat().st_size > 3_000_000
    assert last - first < 300_000  # six chunks' index, and how full the open chunk is by chance: below half a MiB
    assert peak < 3_000_000


def test_a_full_disk_is_one_line_and_leaves_what_was_written(tmp_path):
    program = textwrap.dedent(f"""
        import resource, signal
        from pathlib import Path
        from edgemap.geometry.errors import EdgemapError
        from support.recordings import FACTS, noise, record
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (1_200_000, 1_200_000))
        try:
            record(Path({str(tmp_path / "a.mcap")!r}), FACTS, noise(200), lossless=True)
        except EdgemapError as error:
            print(error)
    """)
    run = subprocess.run([sys.executable, "-c", program], cwd=TESTS, capture_output=True, text=True, check=False)
    assert run.stdout.strip().endswith("a.mcap: cannot be written (File too large)"), run.stderr
    with open_camera(str(tmp_path / "a.mcap")) as camera:
        assert camera.info.frame_count > 50


def test_inertial_samples_are_replayed_bit_for_bit(tmp_path):
    random = np.random.default_rng(1)
    frames = []
    for frame in noise(3):
        stamps_s = np.round(frame.stamp_s - np.array([0.02, 0.01, 0.0]), 6)
        frames.append(replace(frame, imu=ImuSamples(stamps_s, random.normal(size=(3, 3)), random.normal(size=(3, 3)))))
    with open_camera(str(record(tmp_path / "a.mcap", FACTS, frames))) as camera:
        played = drain(camera)
    for frame, again in zip(frames, played, strict=True):
        np.testing.assert_array_equal(again.imu.stamps_s, frame.imu.stamps_s)
        np.testing.assert_array_equal(again.imu.gyro_rad_s, frame.imu.gyro_rad_s)
        np.testing.assert_array_equal(again.imu.accel_m_s2, frame.imu.accel_m_s2)


def test_depth_is_replayed_bit_for_bit_or_left_out(tmp_path):
    """Millimetres, tenths of them, any floats with what is no number, and none."""
    random = np.random.default_rng(2)
    raw = random.integers(0, 65536, (48, 64)).astype(np.float32)
    wild = random.normal(size=(48, 64)).astype(np.float32)
    wild[0, :3] = np.nan, np.inf, 7e6
    depths = [raw / np.float32(1000), raw / np.float32(10000), wild, None, np.zeros((48, 64), np.float32)]
    frames = [replace(frame, depth=depth) for frame, depth in zip(noise(5), depths, strict=True)]
    path = str(record(tmp_path / "a.mcap", FACTS, frames))
    with open_camera(path) as camera:
        assert camera.info.size == (64, 48)
        played = drain(camera)
    for frame, again in zip(frames, played, strict=True):
        if frame.depth is None:
            assert again.depth is None
        else:
            assert again.depth.dtype == np.float32
            np.testing.assert_array_equal(again.depth.view(np.uint32), frame.depth.view(np.uint32))
    with open_camera(path, CameraOptions(depth=False)) as camera:
        assert all(frame.depth is None for frame in drain(camera))


def test_a_damaged_depth_picture_is_none_and_the_next_is_read(tmp_path, monkeypatch):
    frames = [replace(frame, depth=np.full((48, 64), 1.5, np.float32)) for frame in noise(3)]
    whole = recorder_module.encoded_depth
    sizes = iter([None, 40, None])
    monkeypatch.setattr(recorder_module, "encoded_depth", lambda d: (whole(d)[0][: next(sizes)], whole(d)[1]))
    with open_camera(str(record(tmp_path / "a.mcap", FACTS, frames))) as camera:
        assert [frame.depth is not None for frame in drain(camera)] == [True, False, True]


def test_depth_of_a_metre_is_a_thousand_steps_for_everybody(tmp_path):
    """REP 118: 16UC1, millimetres."""
    data, form = encoded_depth(np.full((4, 6), 1.25, np.float32))
    assert form.split(";")[0] == "16UC1"
    assert (cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED) == 1250).all()
