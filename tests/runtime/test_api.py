"""What embedding programs import."""

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
