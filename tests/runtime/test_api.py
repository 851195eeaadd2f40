"""What embedding programs import."""

import importlib
import subprocess
import sys

import pytest

import edgemap.runtime


def test_importing_the_room_is_light():
    code = (
        "import sys, edgemap.runtime\n"
        "heavy = {'numpy', 'cv2', 'onnxruntime', 'scipy'} & set(sys.modules)\nassert not heavy, heavy\n"
        "from edgemap.runtime import Pipeline\nassert 'onnxruntime' in sys.modules"
    )
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stderr


@pytest.mark.parametrize("name", edgemap.runtime.__all__)
def test_every_name_is_there_under_its_own_name(name):
    assert getattr(edgemap.runtime, name).__name__ == name
    assert name in dir(edgemap.runtime)


def test_the_lists_of_names_agree():
    assert sorted(edgemap.runtime.__all__) == sorted(edgemap.runtime.EXPORTS)


def test_other_names_are_missing_as_usual():
    with pytest.raises(AttributeError, match="no attribute 'unicorn'"):
        _ = edgemap.runtime.unicorn


FORMER = """
import sys
from edgemap.runtime.cameras.protocol import Device
from edgemap.runtime.cameras.imu_buffer import ImuBuffer
from edgemap.runtime.errors import CameraError
import edgemap.runtime.odometry.protocol as protocol
import edgemap.runtime.cameras
from edgemap.runtime.frames import errors
from edgemap.runtime.inputs.cameras import imu_buffer, protocol as cameras
from edgemap.runtime.motion.odometry import protocol as odometry
assert Device is cameras.Device and ImuBuffer is imu_buffer.ImuBuffer and CameraError is errors.CameraError
assert protocol is odometry and edgemap.runtime.cameras.open_camera is edgemap.runtime.inputs.cameras.open_camera
"""


def test_documented_modules_keep_their_former_names():
    """A plugin that was written before the rooms catches and raises the same classes."""
    result = subprocess.run([sys.executable, "-c", FORMER], capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stderr


@pytest.mark.parametrize("name", sorted(edgemap.runtime.FORMER_MODULES))
def test_a_former_module_is_the_one_of_today(name):
    module = importlib.import_module(name)
    assert module is importlib.import_module(f"edgemap.runtime.{edgemap.runtime.FORMER_MODULES[name]}")
