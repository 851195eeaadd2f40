"""The pages tell the truth: commands exist with their flags, Python and the notebook run, links lead
somewhere."""

import functools
import pkgutil
import re
import shlex
import subprocess
from base64 import b64decode
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml
from support.pictures import write_video

from edgemap.cli import BRIDGES, COMMANDS
from edgemap.runtime.network import store

ROOT = Path(__file__).parents[1]
MODELS = [ROOT / "models" / name for name in ("README.md", "TRAINING.md")]
PAGES = [ROOT / "README.md", *MODELS, *sorted((ROOT / "docs").glob("*.md"))]
RUN_HERE = [page for page in PAGES if page.name != "plugins.md"]  # test_plugins installs and runs what that shows


def shown_commands():
    """Every `edgemap …` command line in code blocks and code spans, comments cut off."""
    found = []
    for page in RUN_HERE:
        text = page.read_text().replace("\\\n", " ")
        blocks = "\n".join(re.findall(r"```sh\n(.*?)```", text, re.S)) + "\n"
        spans = re.findall(r"`((?:\.venv/bin/)?edgemap [^`\n]+)`", text)
        for line in [*blocks.splitlines(), *spans]:
            line = line.split(" #")[0].strip().removeprefix(".venv/bin/")
            if line.startswith("edgemap ") and not line.startswith("edgemap COMMAND"):
                found.append(line)
    return sorted(set(found))


def test_there_are_commands_to_check():
    assert len(shown_commands()) >= 10


@pytest.fixture(scope="session")
def help_of(edgemap):
    """What `edgemap COMMAND --help` prints; each command is asked once."""

    @functools.cache
    def ask(command):
        result = edgemap.ok(*command.split(), "--help")
        return result.stdout

    return ask


@pytest.mark.parametrize("line", shown_commands())
def test_every_shown_command_exists_with_its_flags(line, help_of):
    words = shlex.split(line)[1:]
    command = next((name for name in (" ".join(words[:2]), words[0]) if name in COMMANDS | BRIDGES), None)
    assert command, f"{line}: no such command"
    for flag in (word.split("=")[0] for word in words if word.startswith("-")):
        assert re.search(rf"(?<![\w-]){re.escape(flag)}(?![\w-])", help_of(command)), f"{line}: {flag} is unknown"


def shown_python():
    """Every block of Python with its page."""
    return [
        pytest.param(block, id=f"{page.relative_to(ROOT)}-{number}")
        for page in RUN_HERE
        for number, block in enumerate(re.findall(r"```python\n(.*?)```", page.read_text(), re.S))
    ]


@pytest.mark.parametrize("block", shown_python())
def test_shown_python_runs(block, painted, tmp_path, monkeypatch, capsys):
    """In an empty folder with a short drive.mp4; painted bundles see a chair in every picture: what is tested is the
    block, not a network."""
    write_video(tmp_path / "drive.mp4")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(store, "shipped_folder", lambda: painted)
    exec(block, {"__name__": "__main__"})
    assert "chair-1" in capsys.readouterr().out


@pytest.mark.parametrize("page", PAGES, ids=lambda page: f"{page.parent.name}/{page.name}")
def test_named_modules_classes_and_folders_exist(page):
    rooms = "geometry|runtime|evaluation|simulation|export|benchmarks|plots|view|cli"
    for name in re.findall(rf"`(?:edgemap\.)?((?:{rooms})(?:\.\w+)+)`", page.read_text()):
        assert pkgutil.resolve_name(f"edgemap.{name}"), name
    for path in re.findall(rf"`((?:{rooms})/[\w/.]+)`(?! of commit| \S+ of commit)", page.read_text()):
        assert (ROOT / path).exists(), path


def shown_targets():
    """Every make target that a page or a comment of the Makefile names."""
    makefile = (ROOT / "Makefile").read_text()
    pages = [*PAGES, ROOT / "CONTRIBUTING.md", ROOT / "SECURITY.md", ROOT / "CHANGELOG.md"]
    texts = [re.sub(r"^[^#]*$", "", makefile, flags=re.M), *(page.read_text() for page in pages)]
    return sorted({name for text in texts for name in re.findall(r"(?:`|^|: )make ([a-z][a-z-]+)", text, re.M)})


def test_make_targets_exist():
    """Each target that the pages name, and no target that .PHONY names is missing."""
    makefile = (ROOT / "Makefile").read_text()
    rules = set(re.findall(r"^([a-z-]+):", makefile, re.M))
    assert {"setup", "run", "view", "test", "check", "lint"} <= set(shown_targets()) <= rules
    (phony,) = re.findall(r"^\.PHONY: (.*)", makefile, re.M)
    assert set(phony.split()) == rules


def test_the_public_workflows_call_what_exists(help_of):
    """Every `run` line is a make target or a command with its flags; only a tag publishes, after the build."""
    folder = ROOT / ".github" / "workflows"
    files = {path.name: yaml.safe_load(path.read_text())["jobs"] for path in folder.glob("*.yml")}
    jobs = {f"{file} {name}": job for file, own in files.items() for name, job in own.items()}
    publish = {name for name, job in jobs.items() if any("publish" in step.get("uses", "") for step in job["steps"])}
    assert publish == {"release.yml publish"}
    assert yaml.safe_load((folder / "release.yml").read_text())[True] == {"push": {"tags": ["v*"]}}  # `on` in YAML 1.1
    lines = [step["run"] for job in jobs.values() for step in job["steps"] if "run" in step]
    assert {"make lint", "make test", "make release"} <= set(lines)
    for line in lines:
        if line.startswith("make "):
            subprocess.run(["make", "-n", line.split()[1]], cwd=ROOT, capture_output=True, check=True)
        elif line.startswith("edgemap "):
            test_every_shown_command_exists_with_its_flags(line.partition(" | ")[0], help_of)
        else:
            assert line == "pip install ."


@pytest.mark.parametrize("page", PAGES, ids=lambda page: f"{page.parent.name}/{page.name}")
def test_links_lead_somewhere(page):
    for target in re.findall(r"\]\(([^)#]+)\)", page.read_text()):
        if "://" not in target:
            assert (page.parent / target).exists(), target


def test_no_package_registry_is_named():
    """Hosts of package indexes are the user's own business: pip's configuration says which."""
    files = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=True).stdout.split()
    hosts = re.compile(r"(pypi|pythonhosted)[.]org|registry[.]npmjs", re.I)
    for name in files:
        path = ROOT / name
        if path.suffix in {".py", ".md", ".txt", ".toml", ".yaml", ""} and path.is_file():
            assert not hosts.search(path.read_text(errors="ignore")), name


def test_the_notebook_runs_and_shows_pictures_and_maps(tmp_path):
    nbformat = pytest.importorskip("nbformat")
    client = pytest.importorskip("nbclient", reason="no nbclient here (extra dev)")
    pytest.importorskip("ipykernel", reason="no kernel here (extra dev)")
    notebook = nbformat.read(ROOT / "docs" / "notebook.ipynb", 4)
    told = [output.output_type for cell in notebook.cells for output in cell.get("outputs", [])]
    assert "execute_result" in told, "the repository's notebook shows its outputs"
    assert "error" not in told
    client.NotebookClient(notebook, timeout=120, resources={"metadata": {"path": str(tmp_path)}}).execute()
    shown = [output for cell in notebook.cells for output in cell.get("outputs", [])]
    assert not [output for output in shown if output.output_type == "error"]
    data = [output.data for output in shown if output.output_type == "execute_result"]
    (picture,) = [item["image/png"] for item in data if "image/png" in item]
    image = cv2.imdecode(np.frombuffer(b64decode(picture), np.uint8), cv2.IMREAD_COLOR)
    assert image.shape == (480, 640, 3)
    (drawn,) = [item["text/html"] for item in data if "text/html" in item]
    assert "suitcase-1" in drawn
    assert (tmp_path / "map.json").is_file()
