"""A run from its own run.json is the same run."""

import json

import pytest
import yaml

from edgemap.cli import main
from edgemap.cli.config_options import config_arguments
from edgemap.cli.run import command
from edgemap.runtime.frames.errors import UsageError


def test_a_run_from_its_own_record_is_the_same_run(tmp_path):
    tuned = tmp_path / "tuned.yaml"
    tuned.write_text("options: {frames: 40, odometry: truth}\nconfig: {association: {min_count: 2}}\n")
    flags = ["--config", str(tuned), "--config-options", "--classes", "chair,couch"]
    main(["run", *flags, "--out", str(tmp_path / "first")])
    record = json.loads((tmp_path / "first" / "run.json").read_text())
    assert record["options"] == {"frames": 40, "odometry": "truth", "classes": "chair,couch"}
    assert record["config"]["association"]["min_count"] == 2
    again = ["--config", str(tmp_path / "first" / "run.json"), "--config-options"]
    main(["run", *again, "--out", str(tmp_path / "again")])
    for name in ("trajectory.tum", "sightings.jsonl"):
        assert (tmp_path / "again" / name).read_bytes() == (tmp_path / "first" / name).read_bytes()
    first, second = (json.loads((tmp_path / name / "map.json").read_text()) for name in ("first", "again"))
    assert first | {"map_id": "", "saved_at": ""} == second | {"map_id": "", "saved_at": ""}
    assert json.loads((tmp_path / "again" / "run.json").read_text())["options"] == record["options"]


STRANGER = {"out": "theirs", "record": "theirs.mcap", "mqtt": "10.0.0.1", "fleet": "10.0.0.1", "view": "0.0.0.0"}


def written(folder, options):
    path = folder / "c.yaml"
    path.write_text(yaml.safe_dump({"options": options, "config": {"association": {"min_count": 2}}}))
    return path


def test_options_come_before_what_is_typed_and_a_strangers_file_sets_tuning_only(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    main(["run", "--config", str(written(tmp_path, STRANGER)), "--frames", "3", "--out", "mine"])
    assert sorted(path.name for path in tmp_path.iterdir()) == ["c.yaml", "mine"]
    told = capsys.readouterr().err
    assert "tuning only; its options (fleet, mqtt, out, record, view) are used with --config-options" in told
    record = json.loads((tmp_path / "mine" / "run.json").read_text())
    assert (record["config"]["association"]["min_count"], record["options"]) == (2, {"frames": 3})
    path = written(tmp_path, {"odometry": "truth", "loop-closure": False, "without_imu": True, "out": "theirs"})
    typed = ["--config", str(path), "--config-options", "--odometry", "hybrid", "-o", "mine"]
    assert config_arguments(typed, command) == ["--no-loop-closure", "--without-imu", *typed]
    told = capsys.readouterr().err.splitlines()
    assert told == [f"{path} sets --no-loop-closure", f"{path} sets --without-imu"]
    assert config_arguments(["--frames", "3"], command) == ["--frames", "3"]


def test_every_switch_may_be_false_and_true(tmp_path, capsys):
    for options in ({"view": False, "ros2": False, "loop-closure": False}, {"loop-closure": True, "realtime": True}):
        path = written(tmp_path, options)
        with pytest.raises(SystemExit) as end:
            main(["run", "--config", str(path), "--config-options", "--frames", "0"])
        assert end.value.code == 2
        assert "--frames 0: must be 1 or more" in capsys.readouterr().err  # every option was understood


NO_OPTIONS = (
    {"nonsense": 1}, {"config": "x"}, {"config-options": True}, {"realtime": "yes"}, {"frames": True},
    {"camera": ["demo"]}, {"out": "a\nb"}, {"out": {"a": 1}},
)  # fmt: skip


@pytest.mark.parametrize("options", NO_OPTIONS)
def test_what_is_no_option_is_one_line(tmp_path, options):
    with pytest.raises(UsageError, match=next(iter(options))):
        config_arguments(["--config", str(written(tmp_path, options)), "--config-options"], command)
