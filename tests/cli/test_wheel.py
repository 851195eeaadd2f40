"""The robot's install: the built wheel in a fresh environment, with base dependencies only."""

import json
import subprocess
import sys
import zipfile
from importlib.metadata import distribution
from pathlib import Path
from xml.etree import ElementTree

import pytest
from packaging.requirements import Requirement
from support.refusal import one_line

ROOT = Path(__file__).parents[2]


def linked(requirements: list[str], site: Path, done: set[str]) -> None:
    """Links what these requirements hold, and theirs in turn, from this environment into another one's packages."""
    for requirement in map(Requirement, requirements):
        name = requirement.name.lower()
        if name in done or (requirement.marker and not requirement.marker.evaluate({"extra": ""})):
            continue
        done.add(name)
        found = distribution(name)
        for entry in {file.parts[0] for file in found.files or ()} - {"..", "__pycache__"}:
            if not (site / entry).exists():
                (site / entry).symlink_to(str(found.locate_file(entry)))
        linked(found.requires or [], site, done)


@pytest.fixture(scope="module")
def robot(tmp_path_factory):
    """Python of an environment that holds the wheel, what it requires, and nothing of the extras. `make release-check`
    installs the same with pip."""
    folder = tmp_path_factory.mktemp("robot")
    build = [sys.executable, "-m", "build", "--wheel", "--no-isolation", "--outdir", folder / "dist", ROOT]
    subprocess.run(build, check=True, capture_output=True)
    (wheel,) = (folder / "dist").glob("*.whl")
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", folder / "venv"], check=True)
    (site,) = folder.glob("venv/lib/python*/site-packages")
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(site)
        (metadata,) = (name for name in archive.namelist() if name.endswith(".dist-info/METADATA"))
        lines = archive.read(metadata).decode().splitlines()
    linked([line.removeprefix("Requires-Dist: ") for line in lines if line.startswith("Requires-Dist")], site, set())
    return folder / "venv" / "bin" / "python"


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
    for name in ("map.png", "map.svg"):  # without matplotlib
        assert f"1 objects; drawn in {name}" in edgemap("map", "show", tmp_path / "run", "--out", name)
    assert "chair-1" in " ".join(ElementTree.parse(tmp_path / "map.svg").getroot().itertext())
    flags = ("--bundle", painted_bundle, "--camera-file", pictures / "camera.yaml", "--json")
    assert json.loads(edgemap("detect", pictures / "0.png", *flags))[0]["detections"]
    bench = edgemap("bench", "--camera", pictures, "--bundle", painted_bundle, "--seconds", "0.3", "--json")
    figures = json.loads(bench)
    assert figures["frames"] > 0
    edgemap("pull", painted_bundle)


def test_a_missing_extra_is_named(robot, painted_bundle, pictures, tmp_path):
    def refusal(*arguments):
        command = [robot, "-m", "edgemap.cli", *map(str, arguments)]
        return one_line(subprocess.run(command, capture_output=True, text=True, check=False, cwd=tmp_path))

    assert "[simulation]" in refusal("run", "--camera", "sim:3", "--out", tmp_path / "sim")
    assert "[export]" in refusal("export", "--backbone", "yolov3-tiny", "-o", tmp_path / "b")
    flags = ("--bundle", painted_bundle, "--camera-file", pictures / "camera.yaml", "--plot", tmp_path / "p")
    assert "[plot]" in refusal("detect", pictures / "0.png", *flags)
    bench = "bench", "--camera", pictures, "--bundle", painted_bundle, "--seconds", "0.2", "--against", "openvino"
    assert "[openvino]" in refusal(*bench)
