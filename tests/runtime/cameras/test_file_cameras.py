"""Videos, folders and drives as cameras: every frame, in order, and one line for what is broken; cameras around
cameras."""

import math
import re
import subprocess
import sys
from contextlib import suppress
from fractions import Fraction
from itertools import islice

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.live_camera import Clock
from support.made_camera import MadeCamera
from support.pictures import noise, write_pictures
from support.recordings import FACTS, drain, record

from edgemap.cli.camera_options import open_described
from edgemap.geometry.camera.imu import ImuSamples
from edgemap.geometry.camera.intrinsics import Intrinsics
from edgemap.geometry.camera.mount import Mount
from edgemap.geometry.se2 import SE2
from edgemap.opening import open_session
from edgemap.runtime.frames.camera import Camera, CameraOptions, check_size, next_frame
from edgemap.runtime.frames.errors import CameraError
from edgemap.runtime.frames.program_camera import FramesCamera, PushedCamera
from edgemap.runtime.frames.trajectory import Trajectory
from edgemap.runtime.inputs.cameras.wrappers import PacedCamera, RotatedCamera, SearchRate
from edgemap.runtime.inputs.drives import CameraFile, write_drive
from edgemap.runtime.inputs.open import DEMO, open_camera

LENS = Intrinsics(64, 48, 58.0, 58.0, 31.5, 23.5)
MOUNT = Mount.from_degrees(0.6, 11.5)


def write_video(path, count=20, fps=10.0):
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"mp4v"), fps, (64, 48))
    for i in range(count):
        writer.write(np.full((48, 64, 3), 10 * i, np.uint8))
    writer.release()
    return path


def test_a_video_gives_every_frame_with_its_time(tmp_path):
    with open_camera(str(write_video(tmp_path / "v.mp4"))) as camera:
        assert isinstance(camera, Camera)
        info = camera.info
        assert (info.size, info.rate_hz, info.frame_count, info.live) == ((64, 48), 10.0, 20, False)
        frames = drain(camera)
    np.testing.assert_allclose([frame.image.mean() for frame in frames], 10 * np.arange(20), atol=4)
    np.testing.assert_allclose([frame.stamp_s for frame in frames], np.arange(20) / 10, atol=1e-3)


@pytest.mark.parametrize(
    ("content", "why"),
    [
        (b"", "not a video that OpenCV reads (0 bytes): cut off, or another format"),
        (b"\0\1 no video", "not a video that OpenCV reads (11 bytes): cut off, or another format"),
        (b"ffconcat version 1.0\nfile other.mp4\n", "a text, not a video"),
        (b"\xef\xbb\xbf<?xml?><MPD>", "a text, not a video"),
        (b"\xffx\nc=IN IP4 127.0.0.1\n", "a text, not a video"),
    ],
)
def test_a_file_that_is_no_video_is_one_line(tmp_path, content, why):
    path = tmp_path / "v.mp4"
    path.write_bytes(content)
    program = f"""
from edgemap.runtime.inputs.open import DEMO, open_camera
try:
    open_camera({str(path)!r})
except Exception as error:
    print(type(error).__name__, error)
"""
    run = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert run.stdout == f"CameraError {path}: {why}\n"
    assert run.stderr == ""  # neither OpenCV nor FFmpeg adds lines of its own


def test_a_folder_is_read_in_natural_order(tmp_path):
    write_pictures(tmp_path / "p", 12)
    with open_camera(str(tmp_path / "p")) as camera:
        assert (camera.info.frame_count, camera.info.size, camera.info.intrinsics) == (12, (64, 48), None)
        assert [int(camera.read().image[0, 0, 0]) for _ in range(12)] == list(range(12))
        assert camera.read() is None


@pytest.mark.parametrize(("frames", "text"), [(15, "ends after 15 frames, 20 poses"), (25, "more frames than the 20")])
def test_a_video_that_does_not_match_its_poses_is_an_error(tmp_path, frames, text):
    way = Trajectory(100.0 + np.arange(20) / 10, tuple(SE2(2.0 + 0.1 * i, 1.0, 0.0) for i in range(20)))
    write_drive(tmp_path, CameraFile(LENS, MOUNT, 10.0), way)
    write_video(tmp_path / "video.mp4", frames)
    with open_camera(f"drive:{tmp_path}") as camera, pytest.raises(CameraError, match=text):
        drain(camera)


def test_pacing_waits_for_each_stamp_and_drops_nothing(tmp_path, monkeypatch):
    write_pictures(tmp_path / "p", 4)
    clock = Clock()
    monkeypatch.setattr("time.sleep", clock.wait)
    camera = PacedCamera(open_camera(str(tmp_path / "p")), clock_s=clock)
    assert camera.read().stamp_s == 0.0
    clock.now_s += 0.03  # the reader works
    assert camera.read().stamp_s == 0.1
    clock.now_s += 0.25  # too slow for two frames
    assert [camera.read().index, camera.read().index] == [2, 3]
    assert clock.waits == pytest.approx([0.07])
    assert camera.read() is None


def test_a_wrapper_shows_what_changes_later():
    camera = MadeCamera(1, lambda _: np.zeros((4, 6, 3), np.uint8))
    outer = SearchRate(PacedCamera(camera), 1.0)
    camera.update_info(mount=Mount(0.7), imu=ImuSamples.none())
    outer.update_info(rate_hz=7.0)
    assert outer.info is camera.info
    assert (outer.info.mount, outer.info.rate_hz) == (Mount(0.7), 7.0)


def test_an_unknown_spec_lists_what_is_understood_and_a_camera_that_is_not_there_is_one_line():
    for spec in ("", "nonsense", "realsens", "kity:/tmp"):
        with pytest.raises(CameraError, match=r"understood.*demo.*realsense.*video file.*KIND:DIR") as caught:
            open_camera(spec)
        assert "\n" not in str(caught.value)
    with pytest.raises(CameraError, match=r"^/dev/video97: no such camera"):
        open_camera("97")


def test_reading_goes_on_past_a_damaged_picture_and_one_of_another_size(tmp_path):
    write_pictures(tmp_path / "p", 5)
    (tmp_path / "p" / "0.png").write_bytes(b"broken")
    (tmp_path / "p" / "2.png").unlink()
    write_pictures(tmp_path / "q", 3, size=(20, 30))
    (tmp_path / "q" / "2.png").rename(tmp_path / "p" / "3.png")
    faults = []
    with open_camera(str(tmp_path / "p")) as camera:
        assert camera.info.size == (64, 48)
        (tmp_path / "p" / "1.png").unlink()
        frames = list(iter(lambda: next_frame(camera, faults.append), None))
    assert [fault.kind.value for fault in faults] == ["damaged", "damaged", "size"]
    assert [(frame.index, frame.stamp_s) for frame in frames] == [(0, 0.3)]  # stamps stay where the files are


GREY = np.full((48, 64, 3), 128, np.uint8)


@pytest.mark.parametrize(
    ("item", "text"),
    [
        ((1.0, GREY), "frames[1][0]=1.0: expected seconds after the picture before, 1.0"),
        ((math.nan, GREY), "frames[1][0]=nan: expected seconds"),
        (("soon", GREY), "frames[1][0]='soon': expected seconds"),
        (None, "frames[1] is NoneType, expected a BGR picture"),
        ((1.1, None), "frames[1][1] is NoneType, expected a BGR picture"),
    ],
)
def test_an_item_of_a_programs_frames_that_cannot_be_is_named(item, text):
    camera = FramesCamera([(1.0, GREY), item])
    assert camera.read().stamp_s == 1.0
    with pytest.raises(CameraError, match=re.escape(text)):
        camera.read()


def test_a_first_pushed_picture_that_is_refused_leaves_nothing_behind():
    camera = PushedCamera(LENS, MOUNT)
    with pytest.raises(CameraError, match="expected three finite numbers"):
        camera.give(GREY, 0.0, wheels=(1.0, 2.0))
    assert (camera.info.size, camera.info.wheel) == ((0, 0), None)
    camera.give(GREY, 0.0)
    assert camera.read().stamp_s == 0.0


def test_a_variable_frame_rate_is_no_cut_and_a_cut_is(tmp_path):
    """Matroska has no count of frames: OpenCV announces its length times its rate."""
    av = pytest.importorskip("av")
    with av.open(str(tmp_path / "vfr.mkv"), "w") as container:
        stream = container.add_stream("mpeg4", rate=10)
        stream.width, stream.height, stream.pix_fmt = 64, 48, "yuv420p"
        stream.time_base = stream.codec_context.time_base = Fraction(1, 1000)
        for index in [*range(60), *range(60, 150, 3)]:
            frame = av.VideoFrame.from_ndarray(np.full((48, 64, 3), index, np.uint8), "bgr24")
            frame.pts, frame.time_base = index * 100, Fraction(1, 1000)
            container.mux(stream.encode(frame))
        container.mux(stream.encode())
    with open_camera(str(tmp_path / "vfr.mkv")) as camera:
        assert len(list(iter(camera.read, None))) == 90
    whole = (tmp_path / "vfr.mkv").read_bytes()
    (tmp_path / "cut.mkv").write_bytes(whole[: len(whole) // 2])
    with open_camera(str(tmp_path / "cut.mkv")) as camera:
        for _ in range(30):
            assert camera.read() is not None
        with pytest.raises(CameraError, match=r"cut\.mkv: cut off, \d\d of \d+ announced frames decoded"):
            list(iter(camera.read, None))


def jpeg(size, level):
    image = np.random.default_rng(level).integers(0, 255, (size[1], size[0], 3), np.uint8)
    return cv2.imencode(".jpg", image)[1].tobytes()


def sizes_of(path):
    """Of the frames before the end, or before one line."""
    sizes = set()
    with open_camera(str(path)) as camera, suppress(CameraError):
        sizes.update(frame.image.shape[:2] for frame in iter(camera.read, None))
    return sizes


def test_a_video_that_changes_its_size_delivers_one_size_or_says_so(tmp_path):
    path = tmp_path / "changing.mjpeg"
    path.write_bytes(b"".join([jpeg((64, 48), k) for k in range(5)] + [jpeg((128, 96), k) for k in range(5, 10)]))
    assert sizes_of(path) == {(48, 64)}


@pytest.mark.parametrize("seed", range(6))
def test_a_video_with_a_broken_middle_ends_in_order(tmp_path, seed):
    random = np.random.default_rng(seed)
    data = bytearray((DEMO / "video.mp4").read_bytes())
    start = int(random.integers(len(data) // 4, len(data) // 2))
    data[start : start + 20_000] = random.bytes(20_000)
    path = tmp_path / "broken.mp4"
    path.write_bytes(data)
    assert sizes_of(path) == {(480, 640)}


class Stamped(MadeCamera):
    """Pictures at these stamps."""

    def __init__(self, stamps_s):
        super().__init__(len(stamps_s), lambda index: noise(index, (48, 64, 3)), size=(64, 48))
        self._stamp_of = stamps_s.__getitem__


def marks(stamps_s, rate_hz):
    return [frame.search for frame in drain(SearchRate(Stamped(stamps_s), rate_hz))]


def test_at_three_of_ten_hertz_the_nearest_pictures_are_searched():
    searched = [index for index, mark in enumerate(marks([i / 10 for i in range(21)], 3.0)) if mark]
    assert searched == [0, 3, 7, 10, 13, 17, 20]


@given(st.integers(1, 60), st.floats(0.5, 60.0), st.lists(st.floats(-0.2, 0.2), min_size=40, max_size=40))
def test_any_rate_is_kept_whatever_the_jitter_and_a_faster_one_searches_all(camera_hz, rate_hz, jitter):
    stamps_s = [(index + part) / camera_hz for index, part in enumerate(jitter)]
    searched = marks(stamps_s, rate_hz)
    assert searched[0]
    if rate_hz >= 2.0 * camera_hz:
        assert all(searched)
    wanted = min(40.0, 39.0 / camera_hz * rate_hz)
    assert sum(searched) <= wanted + 3.0
    if rate_hz <= 0.5 * camera_hz:
        assert sum(searched) >= wanted - 2.0


@pytest.mark.parametrize("later_s", [-50.0, 50.0])
def test_a_clock_that_is_set_and_a_gap_leave_nothing_unsearched(later_s):
    stamps_s = [index / 10 for index in range(20)]
    searched = marks(stamps_s + [100.0 + later_s + one for one in stamps_s], 5.0)
    assert 9 <= sum(searched[20:]) <= 12


def test_a_recording_keeps_which_pictures_were_searched(tmp_path):
    frames = drain(SearchRate(Stamped([index / 10 for index in range(10)]), 3.0))
    path = record(tmp_path / "a.mcap", FACTS, frames, lossless=True)
    with open_camera(str(path)) as tape:
        assert [frame.search for frame in drain(tape)] == [frame.search for frame in frames]


def test_the_demo_keeps_its_objects_at_three_hertz():
    session = open_session(SearchRate(open_camera("demo"), 3.0))
    searched = [step.observed.searched for step in islice(session, 200)]
    assert 0.9 * 60 <= sum(searched) <= 61  # 20 s; a blind picture is not searched
    assert len(session.map) >= 5, len(session.map)


@pytest.mark.parametrize("degrees", [90, 180, 270])
def test_two_turns_that_add_up_to_a_whole_one_change_nothing(degrees):
    with open_described("demo", None) as camera:
        whole = RotatedCamera(RotatedCamera(camera, degrees), 360 - degrees)
        assert whole.info.size == camera.info.size
        assert whole.info.intrinsics == camera.info.intrinsics
        turned, plain = RotatedCamera(camera, degrees).read(), whole.read()
    assert turned.image.shape[:2] == ((480, 640) if degrees == 180 else (640, 480))
    with open_described("demo", None) as again:
        first, second = islice(iter(again.read, None), 2)
    np.testing.assert_array_equal(turned.image, np.rot90(first.image, -degrees // 90))
    np.testing.assert_array_equal(plain.image, second.image)


def test_what_is_stated_is_of_the_upright_pictures():
    with open_described("demo", None) as camera:
        lens = camera.info.intrinsics
    upright = lens.rotated(90)
    session = open_session("demo", intrinsics=upright, rotate=90)
    for camera in (open_described("demo", None, CameraOptions(intrinsics=upright, rotate=90)), session.camera):
        with camera:
            assert camera.info.intrinsics == upright
            assert camera.info.size == camera.read().image.shape[1::-1] == (480, 640)
            assert camera.info.mount is not None


def test_gravity_of_a_camera_on_its_side_points_up_in_upright_pictures():
    """Its picture's right side is up, so turning it counterclockwise (270 clockwise) makes it upright: up is -y."""
    camera = FramesCamera([np.zeros((48, 64, 3), np.uint8)])
    samples = ImuSamples(np.zeros(1), np.zeros((1, 3)), np.array([[9.81, 0.0, 0.0]]))
    camera.update_info(imu=samples)
    frame = RotatedCamera(camera, 270).read()
    np.testing.assert_allclose(frame.imu.accel_m_s2, [[0.0, -9.81, 0.0]], atol=1e-12)


def test_pictures_without_room_for_anything_are_one_line():
    camera = FramesCamera([np.zeros((12, 64, 3), np.uint8)])
    with pytest.raises(CameraError, match="pictures of 64x12 px, both sides must have 32 px or more"):
        check_size(camera)
