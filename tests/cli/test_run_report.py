"""What a run leaves to look at: report.html, and the verdicts where the source knows what stands there."""

import gc


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


def test_a_run_keeps_no_network_for_rows_that_its_pictures_do_not_reach(tmp_path, monkeypatch):
    from edgemap.cli import drive, main
    from edgemap.runtime.network.network import Network

    def whole_networks():
        gc.collect()
        return sum(isinstance(one, Network) and one.inputs.get("image", (0,) * 4)[2] == 416 for one in gc.get_objects())

    before, during, run = whole_networks(), [], drive.run
    monkeypatch.setattr(drive, "run", lambda *given: during.append(whole_networks()) or run(*given))
    main(["run", "--frames", "1", "--threads", "1", "-o", str(tmp_path / "run")])
    assert during == [before]
