"""An installed wheel holds every package: the list in pyproject.toml against the folders."""

import subprocess
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
NOT_INSTALLED = {"tests", "scripts", "docs", "deploy", "models", "plots"}


def test_every_package_is_installed():
    listed = subprocess.run(["git", "ls-files", "*.py"], cwd=ROOT, capture_output=True, text=True, check=False)
    if listed.returncode != 0:
        pytest.skip("no git checkout here")
    folders = {Path(line).parent for line in listed.stdout.split()}
    names = {folder.parts for folder in folders if folder.parts[:1] and folder.parts[0] not in NOT_INSTALLED}
    packages = {".".join(("edgemap", *parts)) if parts != ("api",) else "edgemap" for parts in names}
    declared = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["setuptools"]["packages"]
    assert packages <= set(declared)
    assert {name.partition(".")[0] for name in declared} == {"edgemap"}
