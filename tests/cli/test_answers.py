"""Mistakes at the command line: each is answered by one line that says what to type."""

import json
import re
import subprocess
import sys
import tomllib
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import cv2
import numpy as np
import pytest

from edgemap.cli import main
from edgemap.cli.camera_options import known_lens, open_described, read_intrinsics
from edgemap.cli.usage import parse_and_call
from edgemap.runtime.frames.extras import EXTRAS

CHAIR = {
    "id": "chair-1", "label": "chair", "x_m": 1.0, "y_m": 2.0, "covariance_m2": [[0.01, 0.0], [0.0, 0.02]],
    "width_m": 0.5, "height_m": 0.9, "count": 7, "confidence": 0.9, "first_seen_s": 0.0, "last_seen_s": 3.0,
}  # fmt: skip


def answer(capsys, *arguments):
    with pytest.raises(SystemExit) as ended:
        main([str(argument) for argument in arguments])
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 1, lines
    return ended.value.code, lines[0]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ("run --frames many", "--frames"),
        ("run --frames", "Missing value for argument '--frames'"),
        ("run --no-such-flag", "run: Unrecognized options: --no-such-flag ("),
        ("run extra", "Unrecognized options: extra"),
        ("run drive.mp4", "drive.mp4: no option; did you mean --camera drive.mp4?"),
        ("run 0", "0: no option; did you mean --camera 0?"),
        ("doctor pictures/", "did you mean --camera pictures/?"),
        ("pull yolov3 a/b", "pull: Unrecognized options: a/b ("),
        ("run --precision int4", "Expected one of ('default', 'float32', 'int8', 'auto')"),
        ("run --confidence high", "--confidence"),
        ("map export x", "--format {geojson,nav2,nav2-vector,nav2-masks,csv,png,svg}"),
        ("map export x --format pdf", "pdf"),
        ("map merge a", "-o OUT, --out OUT"),
        ("eval detection", "--data"),
        ("bench --rate fast", "Error parsing --rate"),
        ("pull", "NAME|URL|FOLDER"),
        ("simulate --seed x -o y", "--seed"),
    ],
)
def test_wrong_usage_is_one_line_that_names_the_help(capsys, arguments, words):
    code, line = answer(capsys, *arguments.split())
    command = arguments.split()[0] if arguments.split()[0] not in ("map", "eval") else " ".join(arguments.split()[:2])
    assert code == 2
    assert words in line
    assert line.endswith(f"(edgemap {command} --help)")
    assert "│" not in line
    assert "---" not in line


def test_intrinsics_of_pictures_of_another_size_are_doubted_once(capsys):
    for _ in range(2):
        read_intrinsics("251,251,160,120", 640, 480)
    (line,) = capsys.readouterr().err.splitlines()
    assert line.endswith(
        "160,120 is far from the middle of 640x480 px: are these numbers for pictures of another size?"
    )
    read_intrinsics("503,503,330,220", 640, 480)
    assert capsys.readouterr().err == ""


def test_intrinsics_in_another_order_are_doubted(capsys):
    read_intrinsics("503,503,240,320", 640, 480)
    assert "240,320 is far from the middle of 640x480 px" in capsys.readouterr().err
    read_intrinsics("503,320,503,240", 640, 480)
    assert "the principal point 503,240 is far from the middle" in capsys.readouterr().err
    read_intrinsics("400,503,320,240", 640, 480)
    assert (
        capsys.readouterr()
        .err.strip()
        .endswith("the focal lengths 400 and 503 px are not alike: is the order fx, fy, cx, cy?")
    )


def test_the_lens_of_a_camera_file_is_doubted_as_a_given_one(capsys, tmp_path):
    cv2.imwrite(str(tmp_path / "0.jpg"), np.full((48, 64, 3), 90, np.uint8))
    (tmp_path / "camera.yaml").write_text("{width: 64, height: 48, fx: 60.0, fy: 60.0, cx: 16.0, cy: 12.0}")
    with open_described(str(tmp_path), None) as camera:
        known_lens(camera, None)
    assert "the principal point 16,12 is far from the middle of 64x48 px" in capsys.readouterr().err
    with open_described(str(tmp_path), None) as camera:
        known_lens(camera, "60,60,32,24")
    assert capsys.readouterr().err == ""


def test_an_onnx_file_that_is_no_model_is_refused_by_its_name(capsys, tmp_path):
    (tmp_path / "net.onnx").write_bytes(b"")
    code, line = answer(capsys, "run", "--bundle", tmp_path / "net.onnx", "--out", tmp_path / "run")
    assert code == 1
    assert "net.onnx" in line


def test_names_that_are_nearly_right(capsys, tmp_path):
    (tmp_path / "map.json").write_text(json.dumps({"format": "edgemap.map/1", "frame": "map", "objects": [CHAIR]}))
    assert answer(capsys, "map", "show", tmp_path / "map.json", "--label", "chairs")[1].endswith("did you mean chair?")
    given = ("--bundle", "edgemap-nano", "--classes", "Chair", "--out", tmp_path / "run")
    assert answer(capsys, "run", *given)[1].endswith("--classes Chair: did you mean chair?")


def test_map_show_draws_without_matplotlib(tmp_path):
    """As on a robot with the base install."""
    (tmp_path / "map.json").write_text(json.dumps({"format": "edgemap.map/1", "frame": "map", "objects": [CHAIR]}))
    for picture in ("map.png", "map.svg"):
        code = (
            "import sys\nsys.modules['matplotlib'] = None\nfrom edgemap.cli import main\n"
            f"main(['map', 'show', {str(tmp_path)!r}, '--out', {str(tmp_path / picture)!r}])"
        )
        result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
        assert result.returncode == 0, result.stderr
        assert f"1 objects; drawn in {tmp_path}/{picture}" in result.stdout
    assert "chair-1" in " ".join(ElementTree.parse(tmp_path / "map.svg").getroot().itertext())


@pytest.mark.parametrize(
    ("arguments", "code", "words"),
    [
        (("run", "--camera", "a" * 5000), 1, "File name too long"),
        (("run", "--bundle", "a" * 5000), 1, "File name too long"),
        (("run", "--config", "a" * 5000), 1, "File name too long"),
        (("map", "show", "a" * 5000), 1, "File name too long"),
        (("pull", "a" * 5000), 1, "File name too long"),
        (("run", "--camera", "drive:~nobody-here/x"), 1, "no such folder"),
        (("run", "--camera", "~nobody-here/x"), 1, "no such file or folder"),
        (("pull", "~nobody-here"), 1, "neither a bundle's folder nor URL"),
        (("run", "--camera", "rtsp://["), 1, "not an address"),
        (("run", "--camera", "sim:" + "9" * 5000), 2, "expected sim:SEED"),
        (("map", "show", "a\x1b[2Jb"), 1, "a [2Jb: cannot be read"),
        (("run", "--camera", "a\nb\x1b[2J/c.mp4"), 1, r"'a\nb\x1b[2J/c.mp4': no such file or folder"),
        (("run", "--camera", "kitti:a\r\n\u202eb"), 1, r"a\r\n\u202eb: no such folder"),
        (("map", "show", "a\nb\udcff"), 1, "cannot be read"),
        (("map", "export", "a\nb", "--format", "csv"), 1, "cannot be read"),
        (("pull", "a\nb"), 1, r"a\nb"),
        (("run", "--camera", "~root\0"), 1, r"~root\x00"),
        (("run", "--bundle", "~\0x"), 2, r"~\x00x"),
        (("map", "show", "~\0"), 1, "embedded null byte"),
        (("calibrate", "intrinsics", "--board", "9" * 5000 + "x6", "--camera", "demo"), 2, "expected COLSxROWS"),
    ],
)
def test_paths_that_the_system_refuses_are_one_line(capsys, arguments, code, words):
    ended, line = answer(capsys, *arguments)
    assert ended == code
    assert words in line
    assert line.isprintable()


def test_a_configuration_of_strange_keys_and_values_is_one_short_line(capsys, tmp_path):
    for name, config in (
        ("config.yaml", {"config": {"a\n\x1b[31m": 1}}),  # a run.json's unknown names are passed over
        ("run.json", {"config": ["a" * 100_000]}),
        ("run.json", {"config": {"floor": {"max_sigma_m": ["b" * 100_000]}}}),
        ("run.json", {"config": {"floor": {"max_sigma_m": "c" * 100_000}}}),
    ):
        path = tmp_path / name
        path.write_text(json.dumps(config))
        code, line = answer(capsys, "run", "--config", path)
        assert code == 1
        assert line.isprintable()
        assert len(line) < 600


def test_doctor_knows_every_extra_and_every_package_of_it():
    project = tomllib.loads((Path(__file__).parents[2] / "pyproject.toml").read_text())["project"]
    extras = {
        extra: {re.split(r"[><=;\[ ]", package)[0] for package in packages}
        for extra, packages in project["optional-dependencies"].items()
        if extra not in ("all", "dev")
    }
    assert {extra: set(modules.values()) for extra, (_, modules) in EXTRAS.items()} == extras


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
    objects = [CHAIR | {"id": "$\\frac{", "label": "$\\x$"}]
    (tmp_path / "map.json").write_text(json.dumps({"format": "edgemap.map/1", "objects": objects}))
    main(["map", "show", str(tmp_path / "map.json")])
    assert kept.read_text() == "mine"
    assert (tmp_path / "map.png").read_bytes().startswith(b"\x89PNG")
    assert not (tmp_path / "map.png").is_symlink()


@pytest.mark.parametrize("limit_kb", [150_000, 400_000, 700_000])
def test_too_little_address_space_is_one_line(limit_kb, tmp_path):
    limited = f"ulimit -v {limit_kb}; exec {sys.executable} -m edgemap.cli run --frames 3 --out {tmp_path}/o"
    ended = subprocess.run(["bash", "-c", limited], capture_output=True, text=True, timeout=60)
    assert (ended.returncode, ended.stderr.count("\n")) == (1, 1)
    assert "MiB (ulimit -v); 768 MiB are needed" in ended.stderr


def test_a_folder_that_was_typed_alone_was_meant_as_the_camera(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "kitchen").mkdir()
    code, line = answer(capsys, "run", "kitchen")
    assert (code, "did you mean --camera kitchen?" in line) == (2, True)


def test_a_path_below_the_home_folder_is_no_folder_named_tilde(tmp_path, monkeypatch):
    """`--out=~/x` reaches the program as it stands: the shell expands a word's own first letter only."""
    monkeypatch.setenv("HOME", str(tmp_path))
    taken = []

    def command(out: Path) -> None:
        taken.append(out)

    parse_and_call(command, "x", ["--out=~/drawn"])
    parse_and_call(command, "x", ["--out", "~/drawn"])
    assert taken == [tmp_path / "drawn"] * 2
