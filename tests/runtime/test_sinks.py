"""Sinks that fail: the run goes on, the failure is told once, and so is its end; what can be kept is kept."""

import shutil
from asyncio import CancelledError

import pytest
from support.faults import kinds, texts
from support.recordings import FACTS, drain
from support.small_disk import fill
from support.steps import Listener, Steps

from edgemap.bridges.ros2.recordings.recorder import Recorder, RecordingSink
from edgemap.runtime.frames.errors import DiskError, OdometryError
from edgemap.runtime.inputs.open import open_camera
from edgemap.runtime.step.sinks import SinkGroup
from edgemap.view.page import LivePage

DISK_KIB = 2048


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
    assert [fault.text for fault in good.faults] == [
        f"MQTT: {text}; the run goes on",
        "MQTT: works again after 0.5 s of stream (5 steps failed)",
    ]
    with pytest.raises(type(error)):
        sinks.close()
    assert good.closed
    assert texts(good.faults[2:]) == f"MQTT: {text}"


def test_an_unknown_failure_keeps_its_traceback_in_the_log(caplog):
    Steps().into(SinkGroup([Listener("ROS 2", range(10), TypeError("a bug"))]), 3)
    (record,) = [record for record in caplog.records if record.levelname == "ERROR"]
    assert record.exc_info[0] is TypeError


def test_a_page_whose_server_is_gone_costs_no_step(tmp_path):
    def gone():
        raise RuntimeError("Event loop is closed")

    page, listener = LivePage({}, tmp_path), Listener()
    sinks, steps = SinkGroup([page, listener]), Steps()
    page.wake_once(gone)
    steps.into(sinks, 3)
    assert listener.frames == [0, 1, 2]
    assert listener.faults[0].text == "live page: RuntimeError: Event loop is closed; the run goes on"


def test_a_recording_goes_on_in_the_same_file_once_the_disk_has_room(small_disk):
    path, listener, steps = small_disk / "a.mcap", Listener(), Steps(64, 48)
    sinks = SinkGroup([RecordingSink(lambda: Recorder(path, FACTS, lossless=True)), listener])
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


def test_a_recording_whose_end_the_disk_does_not_take_is_good_up_to_its_last_chunk(small_disk):
    path, steps = small_disk / "a.mcap", Steps(64, 48)
    sinks = SinkGroup([RecordingSink(lambda: Recorder(path, FACTS, lossless=True))])
    steps.into(sinks, 100)
    fill(small_disk)
    steps.into(sinks, 100)
    with pytest.raises(DiskError, match="No space left") as caught:
        sinks.close()
    assert caught.value.exit_code == 4
    with open_camera(str(path)) as camera:
        assert camera.read() is not None


def test_a_recording_begins_again_where_its_folder_vanished_and_is_back(tmp_path):
    path, listener, steps = tmp_path / "stick" / "a.mcap", Listener(), Steps(64, 48)
    sinks = SinkGroup([RecordingSink(lambda: Recorder(path, FACTS, lossless=True)), listener])
    steps.into(sinks, 20)
    shutil.rmtree(path.parent)
    steps.into(sinks, 100)
    assert "cannot be written (No such file or directory)" in listener.faults[0].text
    path.parent.mkdir()
    steps.into(sinks, 20)
    sinks.close()
    assert kinds(listener.faults) == ["output", "output_restored"]
    with open_camera(str(path)) as camera:
        assert [frame.stamp_s for frame in drain(camera)] == pytest.approx([0.1 * i for i in range(120, 140)])
