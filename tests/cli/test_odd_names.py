"""File names that are not UTF-8, or not of the locale: the real command ends with a map or one line, never a signal."""

import os
import shutil
import subprocess
import sys

import cv2
import numpy as np
import pytest

from edgemap.runtime.inputs.open import DEMO

ODD = os.fsdecode(b"\xff1")
LENS = ["--mount", "0.6,11", "--intrinsics", "587,587,319,239"]
PLAIN_C = {"LC_ALL": "C", "PYTHONUTF8": "0"}


def ended(done):
    """Exit code and all output of a command that printed no traceback."""
    text = done.stdout + done.stderr
    assert "Traceback" not in text
    assert "No module" not in text
    assert done.returncode in (0, 1, 2), text
    return done.returncode, text


def in_plain_c(*arguments, cwd):
    """The command in a process whose interpreter started with another locale."""
    command = [sys.executable, "-m", "edgemap.cli", *map(str, arguments)]
    texts = {"capture_output": True, "encoding": "utf-8", "errors": "replace"}
    return subprocess.run(command, cwd=cwd, env=os.environ | PLAIN_C, timeout=120, check=False, **texts)


def demo_in(folder):
    """The demo's drive, copied."""
    folder.mkdir()
    for path in DEMO.iterdir():
        if path.suffix in (".mp4", ".yaml", ".tum", ".json", ".csv"):
            shutil.copy(path, folder)
    return folder


def test_a_video_of_such_a_name_is_one_line(edgemap, tmp_path):
    video = next(demo_in(tmp_path / "d").glob("*.mp4")).rename(tmp_path / f"v{ODD}.mp4")
    code, text = ended(edgemap("run", "--camera", video, *LENS, "--frames", 2, "--out", "o", cwd=tmp_path))
    assert (code, text.count("not UTF-8")) == (1, 1), text


@pytest.mark.parametrize("command", [["run", "--frames", "2"], ["eval", "map", "--frames", "2"]])
def test_a_drive_in_such_a_folder_is_one_line(edgemap, tmp_path, command):
    where = "--data" if command[0] == "eval" else "--camera"
    code, text = ended(edgemap(*command, where, f"drive:{demo_in(tmp_path / ODD)}", cwd=tmp_path))
    assert (code, text.count("not UTF-8")) == (1, 1), text


def test_a_run_folder_of_such_a_name_holds_all_that_a_run_writes(edgemap, tmp_path):
    assert ended(edgemap("run", "--frames", 3, "--out", f"o{ODD}", cwd=tmp_path))[0] == 0
    written = {path.name for path in (tmp_path / f"o{ODD}").iterdir()}
    assert {"map.json", "trajectory.tum", "run.json", "mount.jpg", "report.html"} <= written
    assert "data:image/jpeg" in (tmp_path / f"o{ODD}" / "report.html").read_text(encoding="utf-8")
    for kind in ("svg", "csv", "nav2"):
        assert ended(edgemap("map", "export", f"o{ODD}", "--format", kind, cwd=tmp_path))[0] == 0


def test_pictures_in_such_a_folder_are_a_camera(edgemap, tmp_path):
    folder = tmp_path / f"p{ODD}"
    folder.mkdir()
    jpeg = cv2.imencode(".jpg", np.random.default_rng(0).integers(0, 255, (96, 128, 3), np.uint8))[1].tobytes()
    for number in range(2):
        (folder / f"{number}.jpg").write_bytes(jpeg)
    given = ["--mount", "0.6,11", "--intrinsics", "120,120,64,48", "--bundle", "edgemap-nano"]
    assert ended(edgemap("run", "--camera", folder, *given, "--out", "o", cwd=tmp_path))[0] == 0
    assert (tmp_path / "o" / "report.html").is_file()


def test_names_beyond_the_locale(tmp_path):
    demo_in(tmp_path / "café")
    code, text = ended(in_plain_c("run", "--camera", "drive:café", "--frames", 2, "--out", "ö", cwd=tmp_path))
    assert (code, (tmp_path / "ö" / "report.html").is_file()) == (0, True), text
    assert ended(in_plain_c("map", "show", "ö", "--out", "ä.svg", cwd=tmp_path))[0] == 0
