"""Cameras of other packages: whatever they return is a frame or a fault, and the run goes on; what `edgemap cameras`
finds."""

import json
import math
import os
import struct
import tomllib
from importlib.metadata import EntryPoint
from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from support.live_camera import drain, picture, scripted

from edgemap.cli import main
from edgemap.geometry.camera.imu import ImuSamples
from edgemap.runtime.frames import plugins
from edgemap.runtime.frames.camera import CameraInfo, next_frame
from edgemap.runtime.frames.errors import CameraError, CameraState, PluginError
from edgemap.runtime.frames.frame import Frame
from edgemap.runtime.inputs.cameras import connected
from edgemap.runtime.inputs.cameras.checked import FAILURES, CheckedCamera
from edgemap.runtime.inputs.open import open_camera

GREY = picture(50)
NO_STAMPS = [None, 1e18, "text", [1.0], np.zeros(3), math.nan, math.inf, 10**400, {}, True, np.datetime64("2026-11-23")]
NO_DEPTHS = [[[1.0]], "text", 7, np.zeros((3, 3), np.float32), np.array([["a"]]), {}]
BACKWARDS = ImuSamples(np.array([2.0, 1.0]), np.zeros((2, 3)), np.zeros((2, 3)))
ANYTHING = st.recursive(
    st.none() | st.booleans() | st.floats() | st.integers() | st.text(max_size=5) | st.binary(max_size=5),
    lambda inner: st.lists(inner, max_size=4) | st.tuples(inner, inner) | st.dictionaries(st.text(max_size=2), inner),
    max_leaves=6,
)


@settings(max_examples=100)
@given(st.lists(ANYTHING | st.tuples(ANYTHING, st.just(GREY), ANYTHING), min_size=1, max_size=6))
@example([(1.0, [[1], [1, 2]])])
@example([(1.0, GREY.astype(np.float64))])
@example([(1.0, np.zeros((0, 0, 3), np.uint8))])
@example([(1.0, np.array(["a"], dtype=object))])
def test_whatever_a_grab_returns_is_a_fault_or_a_picture(returned):
    """A fault for all that stays no picture; the camera goes on without being opened again."""
    camera, driver, _ = scripted(dict(enumerate(returned, 3)))
    faults = []
    assert len(drain(camera, 12, faults)) == 12
    assert {fault.kind.value for fault in faults if not fault.kind.notice} <= {"format", "size", "stamp", "clock"}
    pictures = (isinstance(one, tuple) and len(one) > 1 and one[1] is GREY for one in returned if one is not None)
    assert faults or all(pictures)
    assert camera.state is CameraState.RUNNING
    assert driver.calls == ["open"]


class Theirs:
    """Another package's camera: `frames` are what `read` returns or raises, one by one."""

    state = CameraState.RUNNING

    def __init__(self, returned, **fields):
        self.returned = list(returned)
        self.info = CameraInfo(**({"name": "lab", "size": (6, 4), "rate_hz": 10.0} | fields))

    def read(self):
        value = self.returned.pop(0) if self.returned else None
        if isinstance(value, Exception):
            raise value
        return value

    def close(self):
        raise OSError("gone")


def frame(number, **fields):
    """A Frame whose fields were changed past its own checks."""
    made = Frame(number, 0.1 * number, picture(number))
    for name, value in fields.items():
        object.__setattr__(made, name, value)
    return made


def read_all(camera):
    """Frames and faults."""
    faults = []
    return list(iter(lambda: next_frame(camera, faults.append), None)), faults


@pytest.mark.parametrize(
    ("wrong", "kind", "left"),
    [
        *(({"stamp_s": stamp}, "stamp", 20) for stamp in NO_STAMPS),
        ({"stamp_s": -5.0}, "clock", 20),
        *(({"depth": depth}, "format", 20) for depth in NO_DEPTHS),
        *(({"image": image}, "format", 17) for image in (None, "text", [[1]], GREY[0], GREY.astype(float))),
        ({"image": [[1], [1, 2]]}, "format", 17),
        ({"image": picture(1, (8, 4))}, "size", 17),
        *(({"imu": imu}, "format", 20) for imu in (None, "text", [1], BACKWARDS)),
        *(({"name": name}, None, 20) for name in (None, 7, "a\nb\udcff")),
        ({"index": "seven"}, None, 20),
    ],
    ids=repr,
)  # fmt: skip
def test_a_frame_with_a_wrong_field_is_one_fault(wrong, kind, left):
    source = Theirs([frame(n, **(wrong if n in (5, 6, 7) else {})) for n in range(20)])
    frames, faults = read_all(CheckedCamera(source, "lab"))
    assert [fault.kind.value for fault in faults] == ([kind] if kind else [])
    assert len(frames) == left
    assert [got.index for got in frames] == list(range(left))
    assert (np.diff([got.stamp_s for got in frames]) > 0.0).all()
    assert all(got.name.isprintable() for got in frames)


def test_a_clock_that_is_set_back_takes_its_samples_along():
    """20 Hz by stamps, whatever the camera states; after frame 9 the clock is 100 s behind."""
    stamps = [0.05 * n - (100.0 if n > 9 else 0.0) for n in range(20)]
    imu = [ImuSamples(np.array([stamp_s - 0.01]), np.zeros((1, 3)), np.ones((1, 3))) for stamp_s in stamps]
    source = Theirs([frame(n, stamp_s=stamps[n], imu=imu[n]) for n in range(20)])
    frames, faults = read_all(CheckedCamera(source, "lab"))
    assert [fault.kind.value for fault in faults] == ["clock"]
    assert np.delete(np.diff([got.stamp_s for got in frames]), 9) == pytest.approx([0.05] * 18)
    assert [got.stamp_s - got.imu.stamps_s[0] for got in frames] == pytest.approx([0.01] * 20)


def test_reads_that_raise_and_return_anything_are_faults_and_come_to_an_end():
    odd = [ValueError("?"), RuntimeError("a\nb"), "text", 7, SimpleNamespace(stamp_s=1.0, image=GREY)]
    source = Theirs([frame(0), *odd, frame(9)])
    frames, faults = read_all(CheckedCamera(source, "lab"))
    assert (len(frames), [fault.kind.value for fault in faults]) == (2, ["failed", "format"])
    assert all("\n" not in str(fault) for fault in faults)
    with pytest.raises(CameraError, match=f"{FAILURES} reads in a row"):
        read_all(CheckedCamera(Theirs(["text"] * 5 * FAILURES), "lab"))


@pytest.mark.parametrize(("field", "value"), [("size", None), ("size", (0, 5)), ("size", "ab")])
def test_a_camera_that_does_not_know_what_it_is_is_one_line(field, value):
    with pytest.raises(CameraError, match=field):
        CheckedCamera(Theirs([], **{field: value}), "lab")


def open_plugin(monkeypatch, given_by):
    class Kind:
        open = staticmethod(lambda address, how: given_by())
        found = staticmethod(list)

    point = EntryPoint("lab", "somewhere:kind", plugins.CAMERAS)
    monkeypatch.setattr(EntryPoint, "load", lambda self: Kind)
    monkeypatch.setattr(plugins, "declared", lambda: [point])
    return open_camera("lab")


@pytest.mark.parametrize("given_by", [lambda: 1 / 0, lambda: None, lambda: "text", lambda: Theirs([], size=None)])
def test_a_plugin_that_gives_no_camera_is_one_line(monkeypatch, given_by):
    with pytest.raises(CameraError, match="lab"):
        open_plugin(monkeypatch, given_by)


EXAMPLE = Path(__file__).parents[3] / "docs" / "examples" / "edgemap-rpicam"


def test_video_devices_are_those_that_capture(tmp_path, monkeypatch):
    """A USB camera's second node carries metadata; a RealSense that librealsense sees is listed once."""
    capabilities = {"video0": 0x04200001, "video1": 0x04A00000, "video2": 0x04201000, "video10": 0x04200001}
    for name in capabilities:
        (tmp_path / name).touch()
        (tmp_path / "sys" / name).mkdir(parents=True)
        (tmp_path / "sys" / name / "name").write_text(f"Camera {name}\n")
    (tmp_path / "sys" / "video10" / "name").write_text("Intel(R) RealSense(TM) Depth Camera\n")

    def capability(handle, request, answer):
        assert request == 0x80685600
        name = Path(f"/proc/self/fd/{handle}").readlink().name
        answer[:] = struct.pack("16s32s32sIII12x", b"uvcvideo", b"", b"", 0, 0x85200001, capabilities[name])

    monkeypatch.setattr("fcntl.ioctl", capability)
    monkeypatch.setattr(connected, "VIDEO_NODES", tmp_path)
    monkeypatch.setattr(connected, "SYSFS", tmp_path / "sys")
    monkeypatch.setattr(connected, "plugins", lambda group: {})
    monkeypatch.setattr("edgemap.runtime.inputs.cameras.realsense.devices", list)
    cameras, notes = connected.connected_cameras()
    assert [(camera.spec, camera.name) for camera in cameras] == [
        (f"{tmp_path}/video0", "Camera video0"),
        (f"{tmp_path}/video2", "Camera video2"),
        (f"{tmp_path}/video10", "Intel(R) RealSense(TM) Depth Camera"),
    ]
    assert notes == []
    monkeypatch.setattr("edgemap.runtime.inputs.cameras.realsense.devices", lambda: [("123", "Intel RealSense D435")])
    cameras, _ = connected.connected_cameras()
    assert [camera.spec for camera in cameras] == ["realsense:123", f"{tmp_path}/video0", f"{tmp_path}/video2"]


def test_two_packages_with_one_kind_are_refused(monkeypatch):
    points = [plugins.EntryPoint("lab", "one", plugins.CAMERAS), plugins.EntryPoint("lab", "other", plugins.CAMERAS)]
    monkeypatch.setattr(plugins, "declared", lambda: points)
    with pytest.raises(PluginError, match="'lab' comes from two packages, one and other"):
        open_camera("lab:1")


@pytest.fixture
def raspberry_pi(tmp_path, monkeypatch):
    """The documented example, declared as its package declares it, and programs that answer as a Raspberry Pi's do."""
    points = tomllib.loads((EXAMPLE / "pyproject.toml").read_text())["project"]["entry-points"][plugins.CAMERAS]
    made = [plugins.EntryPoint(name, value, plugins.CAMERAS) for name, value in points.items()]
    monkeypatch.setattr(plugins, "declared", lambda: made)
    monkeypatch.syspath_prepend(EXAMPLE)
    folder, programs = tmp_path, tmp_path / "bin"
    monkeypatch.setenv("PATH", f"{programs}:{os.environ['PATH']}")
    for number in range(3):
        picture = np.full((480, 640, 3), 40 * number + 20, np.uint8)
        cv2.imwrite(str(folder / f"{number}.jpg"), picture)
    programs.mkdir()
    (programs / "rpicam-hello").write_text(
        "#!/bin/sh\nprintf 'Available cameras\\n-----------------\\n"
        "0 : imx708 [4608x2592 10-bit RGGB] (/base/axi/pcie@120000/rp1/i2c@88000/imx708@1a)\\n"
        "    Modes: ...\\n1 : ov5647 [2592x1944 10-bit GBRG] (...)\\n'\n"
    )
    (programs / "rpicam-vid").write_text(
        f'#!/bin/sh\necho "$@" > {folder}/arguments\ntouch {folder}/started.$$\n'
        f"for i in 1 2 3 4 5; do for n in 0 1 2; do cat {folder}/$n.jpg; sleep 0.05; done; done\n"
    )
    for program in programs.iterdir():
        program.chmod(0o755)
    return folder


def test_the_example_lists_its_cameras(raspberry_pi, capsys):
    main(["cameras"])
    shown = capsys.readouterr().out
    assert "rpicam:1 " in shown
    assert "edgemap run --camera rpicam:0 --mount HEIGHT_M,PITCH_DEG --intrinsics FX,FY,CX,CY" in shown
    assert "edgemap run --camera rpicam:0 --mount HEIGHT_M      (lens and pitch are guessed)" in shown
    main(["cameras", "--json"])
    cameras = [one for one in json.loads(capsys.readouterr().out)["cameras"] if one["kind"] == "rpicam"]
    assert [(camera["spec"], camera["name"]) for camera in cameras] == [("rpicam:0", "imx708"), ("rpicam:1", "ov5647")]


def test_the_example_delivers_and_is_recovered(raspberry_pi):
    """Frames arrive whole and in order, and a program that ends is started again."""
    faults = []
    with open_camera("rpicam:1") as camera:
        assert camera.info.live
        assert camera.info.size == (640, 480)
        frames = drain(camera, 25, faults)
    assert (raspberry_pi / "arguments").read_text().startswith("--camera 1 ")
    levels = [int(frame.image.mean()) for frame in frames]
    assert set(levels) <= {20, 60, 100}
    assert len(set(levels)) == 3
    assert len(list(raspberry_pi.glob("started.*"))) >= 2
    assert [fault.kind.value for fault in faults][:2] == ["failed", "recovered"]
    with pytest.raises(CameraError, match="NUMBER must be a whole number"):
        open_camera("rpicam:x")
