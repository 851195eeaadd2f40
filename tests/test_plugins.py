"""Packages of others: the documented example, installed, and broken ones."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

DOCS = Path(__file__).parents[1] / "docs"
EXAMPLE = DOCS / "examples" / "edgemap-lab"


@pytest.fixture(scope="module")
def lab(tmp_path_factory):
    """The folder in which the example is installed."""
    folder = tmp_path_factory.mktemp("lab")
    if subprocess.run([sys.executable, "-m", "pip", "--version"], capture_output=True, check=False).returncode:
        pytest.skip("no pip here")
    source = shutil.copytree(EXAMPLE, folder / "source")  # building leaves files behind
    install = ["-m", "pip", "install", "-q", "--no-deps", "--no-build-isolation", "--no-index", "-t", folder / "site"]
    subprocess.run([sys.executable, *install, source], check=True, capture_output=True)
    return folder / "site"


@pytest.fixture
def broken(tmp_path):
    """A folder with the metadata of a package whose module is missing."""
    info = tmp_path / "site" / "broken-1.dist-info"
    info.mkdir(parents=True)
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: broken\nVersion: 1\n")
    groups = ("cameras", "sinks", "commands")
    text = "".join(f"[edgemap.{group}]\nbroken = no_such_module:x\n" for group in groups)
    (info / "entry_points.txt").write_text(text)
    return tmp_path / "site"


def run(site, *arguments, folder=None):
    environment = os.environ | {"PYTHONPATH": str(site)}
    command = [sys.executable, "-m", "edgemap.cli", *map(str, arguments)]
    return subprocess.run(command, env=environment, cwd=folder, capture_output=True, text=True, check=False)


def test_the_page_shows_the_example():
    page = (DOCS / "plugins.md").read_text()
    assert (EXAMPLE / "edgemap_lab.py").read_text() in page
    declared = (EXAMPLE / "pyproject.toml").read_text()
    points = declared[declared.index("[project.entry-points") : declared.index("[tool.setuptools]")]
    assert points.strip() in page


def test_a_camera_a_sink_and_a_command_of_a_package(lab, tmp_path):
    flags = ("--mount", "0.6,11", "--intrinsics", "587,587,319.5,239.5", "--sink", "lab:poses.txt", "-o", "noise")
    ran = run(lab, "run", "--camera", "lab:6", *flags, folder=tmp_path)
    assert ran.returncode == 0, ran.stderr
    assert json.loads((tmp_path / "noise" / "run.json").read_text())["frames"] == 6
    told = run(lab, "lab", "poses.txt", folder=tmp_path)
    assert told.returncode == 0, told.stderr
    assert told.stdout.startswith("6 poses, ")
    assert "distance of the last pose" in run(lab, "lab", "--help").stdout
    assert "lab:12" in run(lab, "cameras").stdout


def test_help_lists_the_commands_of_packages(lab, broken):
    shown = run(f"{lab}{os.pathsep}{broken}", "--help")
    assert shown.returncode == 0
    lines = [line.split(None, 1) for line in shown.stdout.splitlines() if "of the package" in line]
    assert sorted(lines) == [["broken", "of the package broken"], ["lab", "of the package edgemap-lab"]]


def test_what_does_not_load_is_one_line(broken, tmp_path):
    for arguments in (("broken",), ("run", "--camera", "broken:1", "-o", tmp_path / "x")):
        ran = run(broken, *arguments)
        assert ran.returncode == 1
        assert len(ran.stderr.splitlines()) == 1
        assert "'broken' of broken does not load (ModuleNotFoundError" in ran.stderr
    ran = run(broken, "run", "--sink", "none", "-o", tmp_path / "y")
    assert ran.returncode == 2
    assert "--sink none: no such sink; installed are broken, fleet, foxglove, mqtt, record, ros2" in ran.stderr


def test_a_sink_that_does_not_open_is_a_fault_and_not_the_end(broken, tmp_path):
    ran = run(broken, "run", "--frames", "3", "--sink", "broken", "-o", tmp_path / "run")
    assert ran.returncode == 0, ran.stderr
    record = json.loads((tmp_path / "run" / "run.json").read_text())
    assert record["frames"] == 3
    assert record["faults"][0]["text"].startswith("broken: edgemap.sinks: 'broken' of broken does not load")
