"""Every kind of command of the pages is run as it stands, but for those that `ELSEWHERE` names with their reason."""

import json
import re
import shlex
import shutil
from itertools import pairwise
from pathlib import Path

import cv2
import pytest
from support.pictures import write_video
from test_readme import shown_commands

from edgemap.cli import COMMANDS, main
from edgemap.runtime.network import store

pytestmark = pytest.mark.slow
DEMO = Path(__file__).parents[1] / "runtime" / "inputs" / "demo"
FRAMES = 12  # of each run
ELSEWHERE = {
    r"realsense|/dev/video|camera 0\b|rpicam|camera ros2:": "a device, or a program, that is not here",
    r"broker\.local|keeper\.local|ROUTER|fleet (serve|show)": "others; tests/cli/test_publishers.py",
    r"\b(DIR2?|FILE|NAME|SPEC|DATA|H,P)\b|\b[XBO]\b|…|\|": "words to be filled in",
    r"^edgemap( \w+){1,2}$(?<!run)(?<!cameras)(?<!doctor)$|^edgemap export --int8$": "a command that needs more",
    r"^edgemap pull|\.onnx|\.cfg|my-bundle|my-flat|\.pt\b": "a model that is not here; tests/export",
    r"^edgemap (train|simulate|bench|eval)": "minutes to hours; tests/export, simulation, benchmarks, evaluation",
    r"^edgemap mcp http": "beside a run; tests/bridges",
    r"--view\b": "ends with Ctrl-C; tests/view",
    r"bag_0\.mcap|--board|lens\.yaml": "other recordings; tests/runtime/recordings, tests/cli/test_calibrate.py",
    r"--format route": "needs a door; tests/runtime/map_formats",
    r"^edgemap run$": "the whole demo; tests/cli/test_config.py",
}


def reason(line: str) -> str | None:
    return next((why for pattern, why in ELSEWHERE.items() if re.search(pattern, line)), None)


def kind(line: str) -> str:
    """The line without the names and numbers in it: one of each kind is run."""
    words = [word for name in COMMANDS for word in name.split()] + ["nav2", "nav2-vector", "nav2-masks", "geojson"]
    parts = [part if part in words or part[0] == "-" else Path(part).suffix[:5] for part in line.split()]
    return re.sub(r"[\d.,]{3,}", "0", " ".join(parts))


HERE = [*{kind(line): line for line in shown_commands() if reason(line) is None}.values()]


@pytest.fixture(scope="module")
def desk(tmp_path_factory):
    """What the pages presume: a run and its copies, a recording, a video, pictures, camera.yaml, a configuration."""
    folder = tmp_path_factory.mktemp("desk")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        main(["run", "--frames", "120", "--rate", "3", "--out", "runs/20260101T000000Z", "--record", "drive.mcap"])
    for name in ("first", "runs/kitchen", "home", "monday", "tuesday", "room"):
        shutil.copytree(folder / "runs" / "20260101T000000Z", folder / name)
    alone = json.loads((folder / "first" / "run.json").read_text())
    alone["quality"]["wheel_frames"] = 0  # as of a phone's video
    (folder / "first" / "run.json").write_text(json.dumps(alone))
    square = [[0, 0], [1, 0], [1, 1], [0, 1]]
    drawn = json.loads((folder / "home" / "map.json").read_text())
    drawn["zones"] = [{"id": f"zone-{n}", "name": one, "corners_m": square} for n, one in ((1, "stairs"), (2, "hall"))]
    (folder / "home" / "map.json").write_text(json.dumps(drawn))
    shutil.copy(folder / "home" / "map.json", folder)
    shutil.copy(folder / "drive.mcap", folder / "cut.mcap")
    write_video(folder / "phone.mp4")
    for name in ("drive", "walk"):
        shutil.copy(folder / "phone.mp4", folder / f"{name}.mp4")
    shutil.copy(folder / "first" / "trajectory.tum", folder / "poses.tum")
    shutil.copy(DEMO / "wheel.csv", folder)
    shutil.copy(DEMO / "camera.yaml", folder)
    shutil.copy(DEMO / "camera.yaml", folder / "first")
    (folder / "tuned.yaml").write_text("config: {}\n")
    (folder / "pictures").mkdir()
    film = cv2.VideoCapture(str(DEMO / "video.mp4"))
    for number in range(FRAMES):
        cv2.imwrite(str(folder / "pictures" / f"{number}.jpg"), film.read()[1])
    shutil.copy(folder / "pictures" / "0.jpg", folder / "photo.jpg")
    return folder


@pytest.mark.parametrize("line", HERE)
def test_a_shown_command_does_what_it_is_shown_for(line, desk, painted, tmp_path, monkeypatch, capsys):
    """On a copy of the desk, so that each finds it as the pages leave it; runs are cut to a few frames, in all of which
    painted bundles see a chair: what is tested is the command, not a network."""
    monkeypatch.setattr(store, "shipped_folder", lambda: painted)
    folder = tmp_path / "desk"
    shutil.copytree(desk, folder, copy_function=lambda source, to: Path(to).hardlink_to(source))
    monkeypatch.chdir(folder)
    words = shlex.split(line.split(" > ")[0])[1:]
    if words[0] == "run":
        words += ["--frames", str(FRAMES)]  # of two the last counts
        words += [] if "--out" in words else ["--out", "new"]
    for target in (word for flag, word in pairwise(words) if flag in ("-o", "--out", "--record")):
        kept = folder / target
        if kept.is_dir():
            shutil.rmtree(kept)
        kept.unlink(missing_ok=True)
    code = 0
    try:
        main(words)
    except SystemExit as end:
        code = end.code
    told = capsys.readouterr()
    assert code in (0, None), told.err
    assert told.out.strip()


def test_most_kinds_of_commands_are_run():
    ran = {name for name in COMMANDS for line in HERE if line.startswith(f"edgemap {name}")}
    assert {"run", "detect", "map show", "map export", "map merge", "record", "cameras", "doctor"} <= ran
