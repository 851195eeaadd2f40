"""The command line as a user meets it: real processes, exit codes, one line per known failure."""

import json
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
from support.pictures import write_scene
from support.refusal import one_line

from edgemap.cli import COMMANDS
from edgemap.runtime.step.map_file import load_map

pytestmark = pytest.mark.slow
DEMO = Path(__file__).parents[2] / "runtime" / "inputs" / "demo"


def test_help_is_quick_names_every_command_and_imports_nothing_heavy(edgemap):
    result = edgemap.ok("--help")
    for words in COMMANDS:
        assert words in result.stdout
    # In one process: what one help imports would be found with it.
    result = subprocess.run([sys.executable, "-c", IMPORTS, *HELPS], capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stderr
    for words in HELPS:
        assert f"usage: edgemap {words}" in result.stdout


HELPS = [
    "run", "detect", "bench", "pull", "export", "eval detection", "eval map", "map show", "record", "doctor",
    "calibrate intrinsics", "calibrate mount", "calibrate tilt",
]  # fmt: skip
IMPORTS = """
import sys
from edgemap.cli import main
def help_of(*words):
    try: main([*words, '--help'])
    except SystemExit as end: assert not end.code
help_of()
heavy = {'torch', 'cv2', 'onnxruntime', 'matplotlib', 'onnx'}
assert not (heavy | {'numpy', 'tyro', 'scipy'}) & set(sys.modules), 'the overview'
help_of('run')
assert 'tyro' in sys.modules and 'typeguard' not in sys.modules, 'tyro asks it about every `A | B`, for half a second'
for words in sys.argv[1:]:
    help_of(*words.split())
    assert not heavy & set(sys.modules), words
"""


@pytest.fixture(scope="module")
def made_once(edgemap, painted_bundle, tmp_path_factory):
    """What a run over twelve pictures prints, and its folder."""
    folder = tmp_path_factory.mktemp("made")
    out = folder / "run"
    return edgemap("run", "--camera", write_scene(folder), "--bundle", painted_bundle, "--out", out), out


@pytest.fixture
def run_folder(made_once, tmp_path):
    """The folder of that run, the test's own copy."""
    return shutil.copytree(made_once[1], tmp_path / "run")


def test_map_show_draws_a_run_of_paper_clustering(edgemap, painted_bundle, pictures, tmp_path):
    out = tmp_path / "run"
    edgemap("run", "--camera", pictures, "--bundle", painted_bundle, "-o", out, "--clustering", "paper")
    assert "chair-1" in edgemap("map", "show", out).stdout
    assert cv2.imread(str(out / "map.png")) is not None


@pytest.mark.parametrize("streams", ["2>&-", ">/dev/full 2>&1"])
def test_a_run_whose_log_takes_nothing_leaves_its_files_alone(painted_bundle, pictures, tmp_path, streams):
    """`2>&-` leaves number 2 free, which the next file opened would get."""
    (pictures / "8.png").write_bytes(b"not a picture")
    words = ["run", "--camera", str(pictures), "--bundle", str(painted_bundle), "--out", str(tmp_path / "run")]
    line = shlex.join([sys.executable, "-u", "-m", "edgemap.cli", *words])
    result = subprocess.run(["sh", "-c", f"{line} {streams}"], capture_output=True, text=True, check=False)
    assert result.returncode == 0
    assert "\nframe 8:" not in result.stdout  # faults went to standard error, which is none
    assert len(load_map(tmp_path / "run")) == 1


@pytest.mark.parametrize(("shift_s", "kept", "share"), [(1e6, 600, 100), (0.0, 20, 65)], ids=["clock", "stop"])
def test_why_names_first_the_wheels_that_bring_nothing_or_stop(edgemap, painted_bundle, tmp_path, shift_s, kept, share):
    """The demo's first 50 frames: the robot drives from the fourth on, and wheels bring the first 20."""
    drive = shutil.copytree(DEMO, tmp_path / "drive")
    header, *rows = (DEMO / "wheel.csv").read_text().splitlines()
    samples = [row.split(",", 1) for row in rows[:kept]]
    shifted = [f"{float(stamp) + shift_s:.3f},{pose}" for stamp, pose in samples]
    (drive / "wheel.csv").write_text("\n".join([header, *shifted]) + "\n")
    flags = ("--frames", "50", "--bundle", painted_bundle, "--out", tmp_path / "run")
    edgemap.ok("run", "--camera", f"drive:{drive}", *flags)
    first = json.loads(edgemap("why", tmp_path / "run", "--json").stdout)["causes"][0]
    assert first["docs"].endswith("#wheels")
    assert first["evidence"][0] == f"{share} % of the frames in motion have no wheel odometry"


def test_why_says_that_a_run_has_not_ended_and_that_an_older_one_has_faults_without_kinds(edgemap, run_folder):
    """As after a kill: run.json is of the last save."""
    record = json.loads((run_folder / "run.json").read_text()) | {"faults": ["frame 3: blind: picture dark"]}
    for ended in (True, False):
        (run_folder / "run.json").write_text(json.dumps(record | {"finished": ended}))
        answer = edgemap("why", run_folder).stdout
        assert ("The run has not ended" in answer) is not ended
        assert answer.count("have no kinds") == 1
    assert json.loads(edgemap("why", run_folder, "--json").stdout)["ended"] is False


def test_map_show_and_why_take_the_last_run(edgemap, run_folder, tmp_path):
    place = tmp_path / "place"
    place.mkdir()
    assert "no run in runs/" in one_line(edgemap("map", "show", cwd=place), 2)
    for name in ("20260101T000000Z", "20260102T000000Z"):
        shutil.copytree(run_folder, place / "runs" / name)
    assert "20260102T000000Z/map.png" in edgemap("map", "show", cwd=place).stdout
    shutil.copytree(run_folder, place / "kitchen", copy_function=shutil.copy)  # as by `run --out kitchen`
    explained = edgemap("why", cwd=place).stdout
    assert explained.startswith("kitchen: map:")
    assert edgemap("why", "kitchen/map.json", cwd=place).stdout == explained


def test_detect_draws_boxes_without_a_mount(edgemap, painted_bundle, pictures, tmp_path):
    flags = ("--bundle", painted_bundle, "--plot", tmp_path / "drawn")
    assert edgemap("detect", pictures / "0.png", *flags).returncode == 0
    drawn, plain = cv2.imread(str(tmp_path / "drawn" / "0.png")), cv2.imread(str(pictures / "0.png"))
    assert drawn.shape == plain.shape
    assert (drawn != plain).any(axis=2).sum() > 100
    assert edgemap("detect", pictures / "0.png", *flags, "--camera-file", pictures / "camera.yaml").returncode == 0
    beside_floor = cv2.imread(str(tmp_path / "drawn" / "0.png"))  # figure 4: the picture beside the floor
    assert beside_floor.shape[1] > 2 * beside_floor.shape[0]


def test_a_picture_that_is_none_ends_a_strict_run_with_map_and_report(edgemap, painted_bundle, pictures, tmp_path):
    (pictures / "8.png").write_bytes(b"not a picture")
    (tmp_path / "strict.yaml").write_text("config: {camera: {strict: true}}")
    strict = ("--config", tmp_path / "strict.yaml", "--bundle", painted_bundle, "--out", tmp_path / "run")
    result = edgemap("run", "--camera", pictures, *strict)
    line = one_line(result)
    assert "8.png: not a picture" in line
    assert f"the map so far (1 objects) is in {tmp_path / 'run'}" in line
    assert load_map(tmp_path / "run")[0].count == 8
    assert "8.png: not a picture" in (tmp_path / "run" / "report.html").read_text()


def test_detect_prints_json_and_distances(edgemap, painted_bundle, pictures):
    flags = ("--bundle", painted_bundle, "--camera-file", pictures / "camera.yaml", "--json")
    first, *others = json.loads(edgemap("detect", pictures, *flags).stdout)
    assert [Path(other["image"]).name for other in others] == [f"{number}.png" for number in range(1, 12)]
    assert json.loads(edgemap("detect", pictures / "7.png", *flags).stdout) == [others[6]]
    assert all(found["on_floor"] == ("x_m" in found) for found in first["detections"])  # places what is on the floor
    chair = first["detections"][0]
    assert (chair["label"], chair["on_floor"]) == ("chair", True)
    assert chair["distance_m"] == pytest.approx(np.hypot(5.0, 0.8), abs=0.01)
    assert first["horizon_row_px"] == pytest.approx(31.5)


def test_bench_prints_the_contract(edgemap, painted_bundle, pictures):
    flags = ("--bundle", painted_bundle, "--rate", "20", "--seconds", "0.5", "--json", "--against", "openvino")
    result = edgemap("bench", "--camera", pictures, *flags)
    figures = json.loads(result.stdout)
    assert {
        "fps", "latency_ms", "stages_ms", "cold_start_s", "peak_rss_mb", "cpu_percent", "threads", "detect_every",
        "provider", "precision", "against", "cpu_ms_per_frame", "engine", "quiet",
    } <= set(figures)  # fmt: skip
    assert {"health", "attitude", "odometry"} <= set(figures["stages_ms"])
    assert set(figures["stages_cpu_ms"]) == set(figures["stages_ms"])
    assert set(figures["paced"]) == {"20", "unpaced"}
    assert {"cpu_ms_per_frame", "cpu_percent", "latency_ms"} <= set(figures["paced"]["20"])
    assert figures["detect_every"] == 1
    assert {"network_ratio", "end_to_end_ratio", "full_ratio", "cpu_ratio"} <= set(figures["against"]["openvino"])


def test_doctor_says_what_works_and_what_to_type(edgemap, painted_bundle, pictures, tmp_path):
    grid = tmp_path / "grid.jpg"
    result = edgemap.ok("doctor", "--camera", pictures, "--bundle", painted_bundle, "--plot", grid)
    for topic in ("processor", "libraries", "cameras", "bundle", "camera", "mount"):
        assert topic in result.stdout
    assert cv2.imread(str(grid)) is not None
    doctor = ("doctor", "--camera", pictures, "--bundle", painted_bundle, "--json")
    result = edgemap(*doctor, "--mount", "0.6,-60")
    assert result.returncode == 1
    broken = [finding for finding in json.loads(result.stdout) if finding["state"] == "broken"]
    assert [finding["topic"] for finding in broken] == ["mount"]
    result = edgemap("doctor", "--camera", pictures, "--bundle", "nope")
    assert result.returncode == 1
    assert "neither a bundle folder nor a known model" in result.stdout


def test_doctor_says_what_a_run_would_guess_and_that_a_tape_helps(edgemap, painted_bundle, pictures):
    """Exit code 0: that run starts."""
    (pictures / "camera.yaml").unlink()
    doctor, lens = ("doctor", "--camera", pictures, "--bundle", painted_bundle, "--json"), "50,50,31.5,31.5"
    for given, lacking in (
        ((), "lens and mount"), (("--intrinsics", lens, "--mount", "0.6"), "pitch"),
    ):  # fmt: skip
        result = edgemap.ok(*doctor, *given)
        (mount,) = (finding for finding in json.loads(result.stdout) if finding["topic"] == "mount")
        assert mount["state"] == "missing"
        assert f"does not say its {lacking}: run guesses" in mount["text"]
        assert "--mount HEIGHT_M" in mount["remedy"]


def test_eval_map_scores_a_drive_with_truth(edgemap, painted_bundle, known_drive):
    """The painted chair stands where geometry puts it: found; a couch that nobody sees is missed."""
    flags = ("--bundle", painted_bundle, "--json")
    result = edgemap.ok("eval", "map", "--data", f"drive:{known_drive}", *flags)
    document = json.loads(result.stdout)
    assert document["odometry"] == "hybrid"  # as `run` has it
    assert (document["objects_true"], document["path_m"]) == (2, 0.0)
    assert [one["real"] for one in document["true"]["reliability"]["bins"]] == [1]
    for name in ("true", "estimated"):
        assert (document[name]["precision"], document[name]["recall"]) == (1.0, 0.5)
        assert document[name]["median_error_m"] < 0.1
    assert {"p90_error_m", "covered95", "f1", "per_class"} <= set(document["true"])
    (known_drive / "objects.json").unlink()
    assert "needs true poses" in one_line(edgemap("eval", "map", "--data", f"drive:{known_drive}", *flags))


def test_mount_flag_keeps_roll_and_lever_arm(edgemap, painted_bundle, pictures, tmp_path):
    text = (pictures / "camera.yaml").read_text().replace("forward_m: 0.0", "forward_m: 0.15")
    (pictures / "camera.yaml").write_text(text.replace("roll_deg: 0.0", "roll_deg: 1.5"))
    run = ("run", "--camera", pictures, "--bundle", painted_bundle, "--mount", "0.9,3", "--out", tmp_path / "run")
    assert edgemap(*run).returncode == 0
    mount = json.loads((tmp_path / "run" / "run.json").read_text())["mount"]
    angles = {"pitch_deg": 3.0, "roll_deg": 1.5}
    assert mount == {"height_m": 0.9, **angles, "forward_m": 0.15, "left_m": 0.0, "platform": "robot"}


def test_a_map_is_drawn_from_what_a_power_cut_left(edgemap, run_folder):
    for name in ("sightings.jsonl", "trajectory.tum"):
        text = (run_folder / name).read_text()
        (run_folder / name).write_text(text[: len(text) - 15])
    (run_folder / "run.json").unlink()
    result = edgemap.ok("map", "show", run_folder)
    assert "chair-1" in result.stdout


def test_the_well_known_pictures_and_a_real_living_room_that_becomes_a_map(edgemap, shared_data, tmp_path):
    flags = ("--bundle", "yolox-nano", "--json")
    for picture, labels in (("dog.jpg", {"dog", "bicycle"}), ("person.jpg", {"person", "dog", "horse"})):
        (document,) = json.loads(edgemap("detect", shared_data / "pictures" / picture, *flags).stdout)
        assert labels <= {entry["label"] for entry in document["detections"]}
    flags = ("--frames", 30, "--bundle", "yolox-nano", "--odometry", "truth", "--out", tmp_path / "run")
    edgemap.ok("run", "--camera", f"c2w:{shared_data / 'hololens'}", *flags)
    assert load_map(tmp_path / "run")
    assert len((tmp_path / "run" / "trajectory.tum").read_text().splitlines()) == 30
    assert edgemap("map", "show", tmp_path / "run").returncode == 0
