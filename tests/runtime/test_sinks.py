"""Sinks that fail, disks that are full or gone, two runs that want one folder: the run goes on, the failure is told
once, and so is its end; what can be kept is kept."""

import json
import shutil
import subprocess
from asyncio import CancelledError
from contextlib import suppress

import pytest
from support.faults import kinds, texts
from support.recordings import FACTS, drain
from support.steps import Listener, Steps

from edgemap.bridges.ros2.recordings.recorder import Recorder
from edgemap.geometry.camera.floor import FloorCamera
from edgemap.geometry.camera.intrinsics import Intrinsics
from edgemap.geometry.camera.mount import Mount
from edgemap.runtime.frames.errors import DiskError, OdometryError, RunFolderError
from edgemap.runtime.frames.faults import FaultKind
from edgemap.runtime.inputs.open import open_camera
from edgemap.runtime.outputs.sinks.kinds import PluginSink
from edgemap.runtime.outputs.sinks.run_folder import RunFolder
from edgemap.runtime.step.map_file import load_map
from edgemap.runtime.step.sinks import SinkGroup

FLOOR = FloorCamera(Intrinsics(320, 240, 250.0, 250.0, 159.5, 119.5), Mount.from_degrees(0.6, 11.5))
RECORDING_KIB = 2048
RUN_KIB = 192  # holds the picture of the mount, the map twice, and the lines


@pytest.fixture
def small_disk(request, tmp_path):
    """A file system of its own, of so many KiB."""
    disk = tmp_path / "disk"
    disk.mkdir()
    command = ["mount", "-t", "tmpfs", "-o", f"size={request.param}k", "tmpfs", str(disk)]
    if (made := subprocess.run(command, capture_output=True, text=True)).returncode:
        pytest.skip(f"no tmpfs can be mounted here: {made.stderr.strip()}")
    yield disk
    subprocess.run(["umount", "-l", str(disk)], check=True)


def fill(disk):
    """Fill it up; the file to delete again."""
    hog = disk / "hog"
    with hog.open("wb", buffering=0) as stream, suppress(OSError):
        while True:
            stream.write(bytes(512))
    return hog


@pytest.mark.parametrize(
    ("error", "text"),
    [
        (OdometryError("no broker at 10.0.0.1:1883"), "no broker at 10.0.0.1:1883"),
        (RuntimeError("the context\nis gone"), "RuntimeError: the context is gone"),
        (CancelledError("its loop"), "CancelledError: its loop"),
    ],
)
def test_a_sink_that_fails_is_told_once_and_gets_every_later_result(error, text):
    bad, good = Listener("MQTT", range(2, 7), error), Listener()
    sinks = SinkGroup([bad, good])
    Steps().into(sinks, 10)
    assert good.frames == list(range(10))
    assert bad.frames == [0, 1, 7, 8, 9]
    assert kinds(good.faults) == ["output", "output_restored"]
    told = f"MQTT: {text}; the run goes on", "MQTT: works again after 0.5 s of stream"
    assert [fault.text for fault in good.faults] == [*told]
    with pytest.raises(type(error)):
        sinks.close()
    assert good.closed
    assert texts(good.faults[2:]) == f"MQTT: {text}"


def test_a_sink_of_another_package_receives_the_boxes_that_came_after_the_last_frame():
    class Late(Listener):
        def last(self, result, objects):
            self.came = result, objects

    late = Late()
    result, objects = Steps().next()
    SinkGroup([PluginSink("theirs", lambda: late), PluginSink("without", Listener)]).last(result, objects)
    assert late.came == (result, objects)


def test_an_unknown_failure_keeps_its_traceback_in_the_log(caplog):
    Steps().into(SinkGroup([Listener("ROS 2", range(10), TypeError("a bug"))]), 3)
    (record,) = [record for record in caplog.records if record.levelname == "ERROR"]
    assert record.exc_info[0] is TypeError


@pytest.mark.parametrize("small_disk", [RECORDING_KIB], indirect=True)
def test_a_recording_goes_on_in_the_same_file_once_the_disk_has_room(small_disk):
    path, listener, steps = small_disk / "a.mcap", Listener(), Steps(64, 48)
    sinks = SinkGroup([Recorder(path, FACTS, lossless=True), listener])
    steps.into(sinks, 60)
    hog = fill(small_disk)
    steps.into(sinks, 120)
    full = f"{path}: cannot be written (No space left on device)"
    assert texts(listener.faults) == f"recording a.mcap: {full}; the run goes on"
    hog.unlink()
    steps.into(sinks, 20)
    sinks.close()
    assert len(listener.frames) == 200
    assert kinds(listener.faults) == ["output", "output_restored"]
    with open_camera(str(path)) as camera:
        stamps = [frame.stamp_s for frame in drain(camera)]
    assert stamps == sorted(set(stamps))
    assert stamps[:60] == pytest.approx([0.1 * i for i in range(60)])
    assert stamps[-20:] == pytest.approx([0.1 * i for i in range(180, 200)])


@pytest.mark.parametrize("small_disk", [RECORDING_KIB], indirect=True)
def test_a_recording_whose_end_the_disk_does_not_take_is_good_up_to_its_last_chunk(small_disk):
    path, steps = small_disk / "a.mcap", Steps(64, 48)
    sinks = SinkGroup([Recorder(path, FACTS, lossless=True)])
    steps.into(sinks, 100)
    fill(small_disk)
    steps.into(sinks, 100)
    with pytest.raises(DiskError, match="No space left") as caught:
        sinks.close()
    assert caught.value.exit_code == 4
    with open_camera(str(path)) as camera:
        assert camera.read() is not None


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


@pytest.mark.parametrize("small_disk", [RUN_KIB], indirect=True)
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


@pytest.mark.parametrize("small_disk", [RUN_KIB], indirect=True)
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


def test_a_folder_that_vanishes_is_made_again_where_its_place_is_there(tmp_path):
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
