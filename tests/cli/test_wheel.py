"""The robot's install: the built wheel in a fresh environment, with base dependencies only."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def robot(tmp_path_factory):
    """Python of a virtual environment that holds the wheel and nothing of the extras."""
    folder = tmp_path_factory.mktemp("robot")
    build = [sys.executable, "-m", "build", "--wheel", "--no-isolation", "--outdir", folder / "dist", ROOT]
    subprocess.run(build, check=True, capture_output=True)
    (wheel,) = (folder / "dist").glob("*.whl")
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", folder / "venv"], check=True)
    python = folder / "venv" / "bin" / "python"
    pip = [sys.executable, "-m", "pip", "--python", python, "install", "-q", "--no-compile"]
    install = [*pip, "--disable-pip-version-check", "-c", ROOT / "constraints.txt", wheel]
    result = subprocess.run(install, capture_output=True, text=True, check=False)
    if result.returncode and "onnection" in result.stderr:
        pytest.skip(f"no package index within reach: {result.stderr.strip().splitlines()[-1]}")
    assert result.returncode == 0, result.stderr
    return python


def test_torch_onnx_and_matplotlib_are_not_there(robot):
    for module in ("torch", "onnx", "matplotlib", "moderngl"):
        assert subprocess.run([robot, "-c", f"import {module}"], capture_output=True, check=False).returncode != 0


def test_the_robot_runs_detects_and_benches(robot, painted_bundle, pictures, tmp_path):
    def edgemap(*arguments):
        command = [robot, "-m", "edgemap.cli", *map(str, arguments)]
        result = subprocess.run(command, capture_output=True, text=True, check=False, cwd=tmp_path)
        assert result.returncode == 0, result.stderr
        return result.stdout

    edgemap("run", "--camera", pictures, "--bundle", painted_bundle, "--out", tmp_path / "run")
    assert json.loads((tmp_path / "run" / "map.json").read_text())["objects"][0]["id"] == "chair-1"
    flags = ("--bundle", painted_bundle, "--camera-file", pictures / "camera.yaml", "--json")
    assert json.loads(edgemap("detect", pictures / "0.png", *flags))[0]["detections"]
    figures = json.loads(
        edgemap("bench", "--camera", pictures, "--bundle", painted_bundle, "--seconds", "0.3", "--json")
    )
    assert figures["frames"] > 0
    edgemap("pull", painted_bundle)


def test_a_missing_extra_is_named(robot, painted_bundle, pictures, tmp_path):
    def refusal(*arguments):
        command = [robot, "-m", "edgemap.cli", *map(str, arguments)]
        result = subprocess.run(command, capture_output=True, text=True, check=False, cwd=tmp_path)
        assert result.returncode == 1, result.stdout
        assert len(result.stderr.strip().splitlines()) == 1, result.stderr
        return result.stderr

    assert "[export]" in refusal("export", "--backbone", "yolov3-tiny", "-o", tmp_path / "b")
    flags = ("--bundle", painted_bundle, "--camera-file", pictures / "camera.yaml", "--plot", tmp_path / "p")
    assert "[plot]" in refusal("detect", pictures / "0.png", *flags)
    assert "[openvino]" in refusal(
        "bench", "--camera", pictures, "--bundle", painted_bundle, "--seconds", "0.2", "--against", "openvino"
    )
