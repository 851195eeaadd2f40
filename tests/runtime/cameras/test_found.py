"""What `edgemap cameras` finds, and cameras that another package brings."""

import json
import os
import struct
import tomllib
from pathlib import Path

import cv2
import numpy as np
import pytest
from support.live_camera import drain

from edgemap.cli import main
from edgemap.runtime.frames import plugins
from edgemap.runtime.frames.errors import CameraError, PluginError
from edgemap.runtime.inputs.cameras import connected
from edgemap.runtime.inputs.open import open_camera

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
