"""Rerun's own programs and reader read what a run logs."""

import math
import signal
import subprocess
import time
from contextlib import closing, contextmanager
from pathlib import Path

import cv2
import numpy as np
import pytest
from support.boxed_room import walls
from support.recordings import LENS, MOUNT
from support.steps import Steps
from support.waiting import answers, free_port, wait_for

from edgemap.runtime.frames.errors import PublishError
from edgemap.runtime.outputs.messages.stream import MessageStream

chunks = pytest.importorskip("rerun.chunk", reason="no rerun-sdk here (extra rerun)")

from edgemap.runtime.outputs.publishers.rerun import RerunStream  # noqa: E402

CAMERA = "/map/odom/base_link/camera_optical_frame"


def program():
    """Rerun's own, not the Python script around it, which signals do not pass."""
    rerun_cli = pytest.importorskip("rerun_cli")
    return str(Path(rerun_cli.__file__).parent / "rerun")


def read_back(path):
    """Entity to the columns of its rows, each a list of (stamp in s, values), by Rerun's reader."""
    found = {}
    for chunk in chunks.RrdReader(path).stream().to_chunks():
        batch = chunk.to_record_batch()
        timed = "stamp" in batch.schema.names
        stamps = (batch.column("stamp").to_numpy(False).astype(np.int64) / 1e9) if timed else [None] * batch.num_rows
        for name in set(batch.schema.names) - {"stamp", "log_time", "log_tick"}:
            rows = batch.column(name).to_pylist()
            kept = found.setdefault(chunk.entity_path, {}).setdefault(name.rpartition(":")[2], [])
            kept += [(stamp, row) for stamp, row in zip(stamps, rows, strict=True) if row is not None]
    return found


@pytest.fixture(scope="module")
def drive(tmp_path_factory):
    """Eleven steps in a file: what was read back, and the last result with its objects."""
    path = tmp_path_factory.mktemp("rerun") / "drive.rrd"
    steps = Steps(boxes=[*walls(-1.0, -2.0, 4.0, 2.0)])
    with closing(RerunStream(path, MessageStream(LENS, MOUNT))) as sink:
        for _ in range(11):
            result, objects = steps.next()
            sink.write(result, objects)
        sink.fault("wheels: silent for 1.2 s")
    return read_back(path), result, objects


def test_pictures_and_boxes_are_read_back(drive):
    found, result, _ = drive
    ((stamp, (blob,)),) = [row for row in found[f"{CAMERA}/picture"]["blob"] if row[0] > 0.95]
    assert stamp == pytest.approx(1.0)
    expected = cv2.imencode(".jpg", result.frame.image, [cv2.IMWRITE_JPEG_QUALITY, 90])[1]
    assert bytes(blob) == expected.tobytes()
    boxes = found[f"{CAMERA}/detections"]
    assert [label[:10] for label in boxes["labels"][-1][1]] == ["chair 0.90", "couch 0.80", "person 0.7"]
    assert boxes["centers"][0][1][0] == [65.0, 110.0]
    assert [row[0] for row in found[f"{CAMERA}/picture"]["blob"]] == pytest.approx([0.0, 1.0])  # of 10 a second
    assert len(boxes["labels"]) == 2
    assert len(found[CAMERA]["translation"]) == 1  # the mount, which does not change
    assert len(found["/map/odom/base_link"]["translation"]) == 11


def test_the_map_and_the_pose_are_read_back(drive):
    found, result, objects = drive
    assert sorted(found["/map/objects"]["labels"][-1][1]) == [item.id for item in objects]
    centres, halves = found["/map/ellipses"]["centers"][-1][1], found["/map/ellipses"]["half_sizes"][-1][1]
    for item, centre, half in zip(objects, centres, halves, strict=True):
        np.testing.assert_allclose(centre[:2], item.position_m, atol=1e-5)
        assert half[0] == pytest.approx(math.sqrt(5.991 * np.linalg.eigvalsh(item.covariance_m2)[-1]), rel=1e-4)
    place = np.sum([found[path]["translation"][-1][1][0] for path in ("/map/odom", "/map/odom/base_link")], axis=0)
    np.testing.assert_allclose(place[:2], [result.pose_map_base.x_m, result.pose_map_base.y_m], atol=1e-6)
    assert found["/faults"]["text"][0][1] == ["wheels: silent for 1.2 s"]


def test_the_floor_is_a_rectangle_with_a_picture_of_the_grid(drive):
    found, result, _ = drive
    corners = np.array(found["/map/floor"]["vertex_positions"][-1][1])
    rows, columns = result.grid.cells.shape
    assert np.ptp(corners, axis=0)[:2] == pytest.approx([columns * 0.05, rows * 0.05])
    assert corners[0, :2] == pytest.approx([result.grid.x_m, result.grid.y_m], abs=1e-5)
    points = np.array(found["/map/odom/base_link/floor_scan"]["positions"][-1][1])
    assert (points[:, 0] > 0.5).all()


def test_reruns_own_check_accepts_it(tmp_path):
    with closing(RerunStream(tmp_path / "a.rrd", MessageStream(LENS, MOUNT))) as sink:
        Steps().into(sink, 3)
    subprocess.run([program(), "rrd", "verify", tmp_path / "a.rrd"], check=True, capture_output=True)


def test_a_file_that_is_there_is_not_written_over(tmp_path):
    (tmp_path / "a.rrd").touch()
    with pytest.raises(PublishError, match=r"a\.rrd: exists already"):
        RerunStream(tmp_path / "a.rrd", MessageStream())
    with pytest.raises(PublishError, match=r"cannot be written"):
        RerunStream(tmp_path / "no" / "such" / "a.rrd", MessageStream())


def test_no_viewer_is_one_line():
    port = free_port()
    with pytest.raises(PublishError, match=rf"no viewer at 127\.0\.0\.1:{port} .*start one there: rerun"):
        RerunStream(("127.0.0.1", port), MessageStream())


@contextmanager
def viewer(port, path):
    """Rerun's program in the viewer's place: what arrives over gRPC it writes into a file."""
    process = subprocess.Popen([program(), "--port", str(port), "--save", path], stderr=subprocess.DEVNULL)
    try:
        wait_for(lambda: answers(port), "the viewer")
        yield process
    finally:
        process.send_signal(signal.SIGCONT)
        process.kill()
        process.wait()


@pytest.mark.timeout(60)
def test_a_viewer_is_told_live_and_again_when_it_comes_back(tmp_path):
    port, first, second, steps = free_port(), tmp_path / "first.rrd", tmp_path / "second.rrd", Steps()
    with viewer(port, first):
        sink = RerunStream(("127.0.0.1", port), MessageStream(LENS, MOUNT), pictures_hz=100.0)
        steps.into(sink, 4)
        wait_for(lambda: first.stat().st_size > 100_000)
    wait_for(lambda: not steps.taken_by(sink))
    with pytest.raises(PublishError, match=rf"^no viewer at 127\.0\.0\.1:{port}$"):
        steps.into(sink)
    with viewer(port, second), closing(sink):
        wait_for(lambda: steps.taken_by(sink))
        steps.into(sink, 12)
        wait_for(lambda: second.stat().st_size > 200_000)
    for path in (first, second):
        assert {"/map/objects", f"{CAMERA}/picture"} <= read_back(path).keys()


@pytest.mark.timeout(60)
def test_a_viewer_that_hangs_holds_up_neither_the_run_nor_its_end(tmp_path, monkeypatch):
    monkeypatch.setattr("edgemap.runtime.outputs.publishers.rerun.PATIENCE_S", 1.0)
    port, steps = free_port(), Steps(640, 480)
    with viewer(port, tmp_path / "a.rrd") as process:
        sink = RerunStream(("127.0.0.1", port), MessageStream(LENS, MOUNT))
        steps.into(sink, 4)
        process.send_signal(signal.SIGSTOP)

        def refused():
            time.sleep(0.05)
            return not steps.taken_by(sink)

        wait_for(refused)
        with pytest.raises(PublishError, match="has taken nothing for 1 s"):
            steps.into(sink)
        process.send_signal(signal.SIGCONT)
        wait_for(lambda: steps.taken_by(sink))
        process.send_signal(signal.SIGSTOP)
        wait_for(refused)
        sink.close()
        sink.close()
