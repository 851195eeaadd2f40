"""The command line itself: Ctrl-C, flags, shards of `simulate`; mistakes, each answered by one line."""

import json
import re
import signal
import tomllib
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest
from support.rooms import mapped

import edgemap.cli
from edgemap.cli import main
from edgemap.cli.camera_options import known_lens, open_described
from edgemap.cli.simulate import homes_of
from edgemap.cli.summary import with_map_so_far
from edgemap.cli.usage import parse_and_call
from edgemap.runtime.frames.extras import EXTRAS
from edgemap.runtime.step.map_file import save_map


def test_ctrl_c_that_a_library_turns_into_its_own_error_is_one_line(monkeypatch, capsys):
    """As extension modules do that are interrupted while they start: initialization failed."""

    def command(*_):
        try:
            signal.raise_signal(signal.SIGINT)
        except KeyboardInterrupt:
            raise ImportError("initialization failed") from None

    monkeypatch.setattr("edgemap.cli._command", command)
    with pytest.raises(SystemExit) as ended:
        edgemap.cli.main(["cameras"])
    assert (ended.value.code, capsys.readouterr().err) == (130, "edgemap cameras: interrupted\n")
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


@pytest.mark.parametrize(("result", "said"), [(object(), "the map so far is in runs/a/\n"), (None, "")])
def test_a_second_one_in_a_run_names_the_folder_of_its_map(capsys, result, said):
    summary: Any = SimpleNamespace(result=result)
    files: Any = SimpleNamespace(folder=Path("runs/a"))
    with pytest.raises(KeyboardInterrupt), with_map_so_far(summary, files):
        raise KeyboardInterrupt
    assert capsys.readouterr().err == said


LIMIT = 34
CONTRACT = """camera bundle rate rotate pose-frame
odometry without-wheels without-imu mount intrinsics camera-file config config-options
classes confidence clustering no-loop-closure out frames realtime map view record engine ros2 foxglove mqtt threads
precision"""


def test_run_has_few_flags_and_doctor_knows_every_extra_and_every_package_of_it(capsys):
    with pytest.raises(SystemExit):
        main(["run", "--help"])
    flags = set(re.findall(r"^. (?:-\w [A-Z]+, )?--(\w[\w-]*)", capsys.readouterr().out, re.MULTILINE)) - {"help"}
    assert set(CONTRACT.split()) <= flags
    assert len(flags) <= LIMIT
    project = tomllib.loads((Path(__file__).parents[2] / "pyproject.toml").read_text())["project"]
    extras = {extra: packages for extra, packages in project["optional-dependencies"].items() if extra != "all"}
    del extras["dev"]
    extras = {extra: {re.split(r"[><=;\[ ]", name)[0] for name in packages} for extra, packages in extras.items()}
    assert {extra: set(modules.values()) for extra, (_, modules) in EXTRAS.items()} == extras


def test_shards_share_the_homes():
    parts = [homes_of("3:14", f"{part}/4") for part in range(1, 5)]
    assert list(parts[1]) == [4, 8, 12]
    assert sorted(home for part in parts for home in part) == list(homes_of("3:14", None)) == list(range(3, 14))


def test_the_lens_of_a_camera_file_is_doubted_as_a_given_one(capsys, tmp_path):
    cv2.imwrite(str(tmp_path / "0.jpg"), np.full((48, 64, 3), 90, np.uint8))
    (tmp_path / "camera.yaml").write_text("{width: 64, height: 48, fx: 60.0, fy: 60.0, cx: 16.0, cy: 12.0}")
    with open_described(str(tmp_path), None) as camera:
        known_lens(camera, None)
    assert "the principal point 16,12 is far from the middle of 64x48 px" in capsys.readouterr().err
    with open_described(str(tmp_path), None) as camera:
        known_lens(camera, "60,60,32,24")
    assert capsys.readouterr().err == ""


def test_a_configuration_of_strange_keys_and_values_is_one_short_line(capsys, tmp_path):
    for name, config in (
        ("config.yaml", {"config": {"a\n\x1b[31m": 1}}),  # a run.json's unknown names are passed over
        ("run.json", {"config": ["a" * 100_000]}),
        ("run.json", {"config": {"grid": {"cell_m": ["b" * 100_000]}}}),
        ("run.json", {"config": {"grid": {"cell_m": "c" * 100_000}}}),
    ):
        path = tmp_path / name
        path.write_text(json.dumps(config))
        with pytest.raises(SystemExit) as ended:
            main(["run", "--config", str(path)])
        (line,) = capsys.readouterr().err.splitlines()
        assert ended.value.code == 1
        assert line.isprintable()
        assert len(line) < 600


def test_doctor_prints_extras_that_are_not_installed_as_one(monkeypatch, capsys):
    """What a run needs stands alone; --json keeps one finding for each."""
    monkeypatch.setattr("importlib.util.find_spec", lambda name, *_: None)
    main(["doctor"])
    lines = capsys.readouterr().out.splitlines()
    (line,) = (line for line in lines if line.startswith("missing  extra"))
    assert "view (run --view)" in line
    assert "plot (figures of detect, eval and bench --plot)" in line
    assert "[NAME]'" in lines[lines.index(line) + 1]
    main(["doctor", "--json"])
    found = [finding for finding in json.loads(capsys.readouterr().out) if finding["topic"] == "extra"]
    assert len(found) == len(EXTRAS)


def test_a_strangers_map_is_drawn_whatever_its_names_and_links_say(tmp_path):
    """map.png beside the map is replaced where it links to a file of the user's."""
    kept = tmp_path / "kept"
    kept.write_text("mine")
    (tmp_path / "map.png").symlink_to(kept)
    save_map(tmp_path / "map.json", [replace(mapped([("chair", 1.0, 2.0)])[0], id="$\\frac{", label="$\\x$")])
    main(["map", "show", str(tmp_path / "map.json")])
    assert kept.read_text() == "mine"
    assert (tmp_path / "map.png").read_bytes().startswith(b"\x89PNG")
    assert not (tmp_path / "map.png").is_symlink()


def test_a_path_below_the_home_folder_is_no_folder_named_tilde(tmp_path, monkeypatch):
    """`--out=~/x` reaches the program as it stands: the shell expands a word's own first letter only."""
    monkeypatch.setenv("HOME", str(tmp_path))
    taken = []

    def command(out: Path) -> None:
        taken.append(out)

    parse_and_call(command, "x", ["--out=~/drawn"])
    parse_and_call(command, "x", ["--out", "~/drawn"])
    assert taken == [tmp_path / "drawn"] * 2
