"""A run from its own run.json is the same run."""

import json

import pytest

from edgemap.cli import main


def test_a_run_from_its_own_record_is_the_same_run(tmp_path):
    tuned = tmp_path / "tuned.yaml"
    tuned.write_text("options: {frames: 40, odometry: planar}\nconfig: {association: {min_count: 2}}\n")
    main(["run", "--config", str(tuned), "--classes", "chair,couch", "--out", str(tmp_path / "first")])
    record = json.loads((tmp_path / "first" / "run.json").read_text())
    assert record["options"] == {"frames": 40, "odometry": "planar", "classes": "chair,couch"}
    assert record["config"]["association"]["min_count"] == 2
    main(["run", "--config", str(tmp_path / "first" / "run.json"), "--out", str(tmp_path / "again")])
    for name in ("map.json", "trajectory.tum", "sightings.jsonl"):
        assert (tmp_path / "again" / name).read_bytes() == (tmp_path / "first" / name).read_bytes()
    assert json.loads((tmp_path / "again" / "run.json").read_text())["options"] == record["options"]


def test_an_unknown_number_is_one_line(tmp_path, capsys):
    (tmp_path / "c.yaml").write_text("config: {asociation: {gate: 3}}\n")
    with pytest.raises(SystemExit) as end:
        main(["run", "--config", str(tmp_path / "c.yaml")])
    assert end.value.code == 1
    assert capsys.readouterr().err.count("\n") == 1
