"""The run folder when two runs want it, when the disk is full or gone, and when the process dies."""

import json
import subprocess
import sys

import pytest
from support.small_disk import fill
from support.steps import Listener, Steps

from edgemap.geometry.camera.floor import FloorCamera
from edgemap.geometry.camera.intrinsics import Intrinsics
from edgemap.geometry.camera.mount import Mount
from edgemap.runtime.frames.errors import DiskError, RunFolderError
from edgemap.runtime.frames.faults import FaultKind
from edgemap.runtime.outputs.sinks.run_folder import RunFolder
from edgemap.runtime.step.map_file import load_map
from edgemap.runtime.step.sinks import SinkGroup

FLOOR = FloorCamera(Intrinsics(320, 240, 250.0, 250.0, 159.5, 119.5), Mount.from_degrees(0.6, 11.5))


DISK_KIB = 192  # holds the picture of the mount, the map twice, and the lines


def told_beside(folder):
    """A run folder in the group that a run makes of its sinks, and the faults told there."""
    told = Listener()
    return SinkGroup([RunFolder(folder, FLOOR, {}), told]), told.faults


def stamps(path):
    return [float(line.split()[0]) for line in (path / "trajectory.tum").read_text().splitlines()]


def test_what_is_on_disk_is_never_a_second_behind(tmp_path):
    files, steps = RunFolder(tmp_path / "run", FLOOR, {}), Steps()
    for _ in range(60):
        files.write(*steps.next())
        newest_s = 0.1 * (steps.index - 1)
        assert newest_s - stamps(tmp_path / "run")[-1] < 1.0
        assert newest_s - max((item.last_seen_s for item in load_map(tmp_path / "run")), default=newest_s) < 1.0
    files.close()
    assert len(stamps(tmp_path / "run")) == 60
    assert sorted(path.name for path in (tmp_path / "run").iterdir()) == [
        "map.json", "mount.jpg", "run.json", "sightings.jsonl", "trajectory.tum",
    ]  # fmt: skip


def test_a_second_run_is_refused_while_the_first_one_lasts_and_after(tmp_path):
    first = RunFolder(tmp_path / "run", FLOOR, {})
    (tmp_path / "run" / "run.json").unlink()
    with pytest.raises(RunFolderError, match="another run writes into it"):
        RunFolder(tmp_path / "run", FLOOR, {})
    first.close()
    with pytest.raises(RunFolderError, match="already holds a run"):
        RunFolder(tmp_path / "run", FLOOR, {})


def test_of_many_runs_at_once_one_gets_the_folder(tmp_path):
    program = (
        "import sys, time; from pathlib import Path\n"
        "from edgemap.runtime.frames.errors import RunFolderError\n"
        "from edgemap.runtime.outputs.sinks.run_folder import RunFolder\n"
        "sys.stdin.readline()\n"
        "try: mine = RunFolder(Path(sys.argv[1]), None, {}); print('mine', flush=True); time.sleep(1)\n"
        "except RunFolderError: print('refused', flush=True)\n"
    )
    command = [sys.executable, "-c", program, str(tmp_path / "run")]
    runs = [subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) for _ in range(3)]
    for run in runs:
        run.stdin.write("\n")
        run.stdin.flush()
    assert sorted(run.communicate()[0].strip() for run in runs) == ["mine", "refused", "refused"]


def test_a_full_disk_costs_no_step_and_saving_resumes(small_disk):
    (files, told), steps = told_beside(small_disk / "run"), Steps()
    steps.into(files, 20)
    hog = fill(small_disk)
    steps.into(files, 60)
    assert len(told) == 1
    assert "cannot be written (No space left on device); the run goes on" in told[0].text
    assert load_map(small_disk / "run")  # the one before is whole
    hog.unlink()
    steps.into(files, 20)
    assert len(told) == 2
    assert told[1].kind is FaultKind.OUTPUT_RESTORED
    files.close()
    record = json.loads((small_disk / "run" / "run.json").read_text())
    assert (record["lines_lost"], record["fault_count"]) == (0, 2)
    assert stamps(small_disk / "run") == pytest.approx([0.1 * i for i in range(100)])
    lines = (small_disk / "run" / "sightings.jsonl").read_text().splitlines()
    assert [json.loads(line)["frame"] for line in lines] == [i for i in range(100) for _ in range(2)]


def test_a_read_only_disk_is_told_and_the_last_save_fails_with_a_code_of_its_own(small_disk):
    (files, told), steps = told_beside(small_disk / "run"), Steps()
    steps.into(files, 5)
    subprocess.run(["mount", "-o", "remount,ro", str(small_disk)], check=True)
    steps.into(files, 20)
    assert len(told) == 1
    assert "Read-only file system" in told[0].text
    with pytest.raises(DiskError, match="Read-only file system") as caught:
        files.close()
    assert caught.value.exit_code == 4


def test_a_folder_that_vanishes_is_made_again_where_its_place_is_there(tmp_path):
    import shutil

    place = tmp_path / "stick"
    place.mkdir()
    (files, told), steps = told_beside(place / "run"), Steps()
    steps.into(files, 5)
    shutil.rmtree(place)
    steps.into(files, 20)
    assert len(told) == 1
    assert "is gone" in told[0].text
    place.mkdir()
    steps.into(files, 20)
    files.close()
    assert [objects.label for objects in load_map(place / "run")] == ["chair", "couch"]
    assert stamps(place / "run")[-1] == pytest.approx(4.4)


@pytest.mark.parametrize("name", ["run.json", "trajectory.tum", "sightings.jsonl"])
def test_a_folder_with_a_file_of_the_runs_is_left_alone_links_too(tmp_path, name):
    """A folder that somebody else packed may hold links to files of ours."""
    folder, kept = tmp_path / "run", tmp_path / "kept"
    folder.mkdir()
    kept.write_text("mine\n")
    (folder / name).symlink_to(kept)
    with pytest.raises(RunFolderError, match="already holds a run"):
        RunFolder(folder, FLOOR, {})
    assert kept.read_text() == "mine\n"
