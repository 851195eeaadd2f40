"""What a run leaves to look at: report.html, and the verdicts where the source knows what stands there."""

import gc
import json
import signal
import subprocess
import sys
import time

import pytest


@pytest.fixture
def known_drive(pictures):
    """The twelve pictures as a drive that stands still before a chair (which the painted bundle sees) and a couch."""
    (pictures / "images").mkdir()
    for path in pictures.glob("*.png"):
        path.rename(pictures / "images" / path.name)
    (pictures / "poses.tum").write_text("".join(f"{index / 10:.1f} 0 0 0 0 0 0 1\n" for index in range(12)))
    footprint = [[5.0, -1.1], [5.5, -1.1], [5.5, -0.6], [5.0, -0.6]]
    common = {"on_floor": True, "footprint_m": footprint, "visible_frames": 12}
    chair = {"id": 1, "label": "chair", "x_m": 5.25, "y_m": -0.84}
    couch = {"id": 2, "label": "couch", "x_m": 1.0, "y_m": 2.0}
    (pictures / "objects.json").write_text(json.dumps({"objects": [chair | common, couch | common]}))
    return pictures


def test_a_drive_with_truth_ends_with_verdicts(edgemap, painted_bundle, known_drive, tmp_path):
    flags = ("--bundle", painted_bundle, "--out", tmp_path / "run")
    result = edgemap("run", "--camera", f"drive:{known_drive}", *flags)
    assert result.returncode == 0, result.stderr
    lines = result.stdout.splitlines()
    assert any(line.split()[0] == "chair-1" and "found, 0.0" in line for line in lines)
    assert any(line.split()[0] == "couch" and line.endswith("missed") for line in lines)
    assert any(line.startswith("against the truth: 1 found, 1 missed; median error 0.0") for line in lines)
    page = (tmp_path / "run" / "report.html").read_text()
    assert "1 found, 1 missed" in page
    assert str(tmp_path / "run" / "report.html") in result.stdout


def test_classes_that_were_not_asked_for_are_not_missed(edgemap, painted_bundle, known_drive, tmp_path):
    flags = ("--bundle", painted_bundle, "--out", tmp_path / "run", "--classes", "chair")
    assert "truth: 1 found;" in edgemap("run", "--camera", f"drive:{known_drive}", *flags).stdout


def test_nothing_is_judged_where_nothing_is_known(edgemap, painted_bundle, pictures, tmp_path):
    result = edgemap("run", "--camera", pictures, "--bundle", painted_bundle, "--out", tmp_path / "run")
    assert "against the truth" not in result.stdout
    assert "Against the truth" not in (tmp_path / "run" / "report.html").read_text()


def test_a_fault_leaves_a_report(edgemap, painted_bundle, pictures, tmp_path):
    (pictures / "8.png").write_bytes(b"not a picture")
    result = edgemap("run", "--strict", "--camera", pictures, "--bundle", painted_bundle, "--out", tmp_path / "run")
    assert result.returncode == 1
    assert "8.png: not a picture" in (tmp_path / "run" / "report.html").read_text()


def test_ctrl_c_leaves_a_report(painted_bundle, pictures, tmp_path):
    out = tmp_path / "run"
    (pictures / "camera.yaml").write_text((pictures / "camera.yaml").read_text().replace("fps: 10.0", "fps: 0.5"))
    command = [sys.executable, "-m", "edgemap.cli", "run", "--camera", str(pictures), "--bundle", str(painted_bundle)]
    process = subprocess.Popen([*command, "--out", str(out), "--realtime"], stdout=subprocess.PIPE, text=True)
    deadline = time.monotonic() + 60
    while time.monotonic() < deadline and not (out / "mount.jpg").exists():
        time.sleep(0.05)
    time.sleep(0.6)
    process.send_signal(signal.SIGINT)
    stdout, _ = process.communicate(timeout=30)
    assert process.returncode == 0
    assert "stopped after" in stdout
    assert "</html>" in (out / "report.html").read_text()


def test_a_run_keeps_no_network_for_rows_that_its_pictures_do_not_reach(tmp_path, monkeypatch):
    from edgemap.cli import main
    from edgemap.runtime.network.network import Network
    from edgemap.runtime.step import loop

    def whole_networks():
        gc.collect()
        return sum(isinstance(one, Network) and one.inputs.get("image", (0,) * 4)[2] == 416 for one in gc.get_objects())

    before, during, run = whole_networks(), [], loop.run
    monkeypatch.setattr(loop, "run", lambda *given: during.append(whole_networks()) or run(*given))
    main(["run", "--frames", "1", "--threads", "1", "-o", str(tmp_path / "run")])
    assert during == [before]
