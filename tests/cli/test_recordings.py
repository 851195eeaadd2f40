"""Record, replay, convert, as a user types it: the map of a replay is the map of the drive, byte for byte."""

import re
import signal
import time
from pathlib import Path

import cv2
import numpy as np
import pytest
from support.rooms import content_of

from edgemap.bridges.ros2.recordings.foreign import read_wheel
from edgemap.bridges.ros2.recordings.recorder import Recorder
from edgemap.cli import main
from edgemap.cli.groups import Source
from edgemap.cli.record import command as record
from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.errors import BridgeError, DiskError
from edgemap.runtime.inputs.open import open_camera
from edgemap.runtime.step.map_file import load_map

FRAMES = 12
WHEEL = Path(__file__).parents[2] / "runtime" / "inputs" / "demo" / "wheel.csv"


@pytest.fixture(scope="module")
def driven(edgemap, painted_bundle, tmp_path_factory):
    """Runs on FRAMES pictures of the demo, threads fixed: driven(name, *flags) -> its folder."""
    folder = tmp_path_factory.mktemp("driven")

    def drive(name, *flags):
        out = folder / name
        common = ("--bundle", painted_bundle, "--frames", FRAMES, "--threads", 2, "--out", out)
        edgemap.ok("run", *flags, *common)
        return out

    return drive


@pytest.fixture(scope="module")
def live(driven, tmp_path_factory):
    """The drive itself, which records what it sees without loss, beside its folder."""
    tape = tmp_path_factory.mktemp("tape") / "live.mcap"
    out = driven("live", "--record", f"lossless:{tape}")
    tape.rename(out.parent / "live.mcap")
    assert load_map(out)
    return out


def same(one, other, name="map.json"):
    if name == "map.json":
        return content_of(one) == content_of(other)
    return (one / name).read_bytes() == (other / name).read_bytes()


def test_a_lossless_recording_gives_the_map_of_the_drive(live, driven):
    again = driven("again", "--camera", live.parent / "live.mcap")
    assert same(live, again)
    assert same(live, again, "trajectory.tum")
    assert same(live, again, "sightings.jsonl")


def test_a_recording_played_twice_gives_one_map(edgemap, live, driven):
    tape = live.parent / "jpeg.mcap"
    result = edgemap.ok("record", "-o", tape, "--frames", FRAMES)
    assert f"{FRAMES} pictures" in result.stdout
    once, twice = (driven(name, "--camera", tape) for name in ("once", "twice"))
    assert same(once, twice)
    assert not same(once, live)  # JPEG is another picture: were it the same, this test would show nothing
    by_file = driven("by-file", "--odometry", f"wheel:{WHEEL}")
    by_tape = driven("by-tape", "--camera", tape, "--odometry", f"wheel:{tape}")
    assert same(by_file, by_tape, "trajectory.tum")
    with open_camera("demo") as demo, open_camera(str(tape)) as camera:
        assert camera.info.truth.poses == demo.info.truth.poses


def test_wheels_that_are_given_go_on_the_tape_before_the_sources_own(edgemap, tmp_path):
    given, tape = tmp_path / "given.csv", tmp_path / "a.mcap"
    given.write_text("stamp_s,x_m,y_m,yaw_rad\n0.0,0.0,0.0,0.0\n0.1,0.25,0.0,0.5\n")
    edgemap.ok("record", "-o", tape, "--frames", 2, "--wheel", given)
    assert read_wheel(str(tape)).poses == (SE2(), SE2(0.25, 0.0, 0.5))


@pytest.mark.parametrize(
    ("words", "left"),
    [
        (["record", "-o", "a.mcap"], "the pictures so far are in a.mcap\n"),
        pytest.param(["run", "--record", "a.mcap", "--out", "run"], "the map so far (1 objects) is in run/",
                     marks=pytest.mark.slow),
    ],
)  # fmt: skip
def test_a_full_disk_names_what_there_is_so_far(monkeypatch, capsys, pictures, painted_bundle, tmp_path, words, left):
    def full(recorder):
        raise DiskError("a.mcap: cannot be written (No space left on device)")

    monkeypatch.setattr(Recorder, "close", full)
    monkeypatch.chdir(tmp_path)
    bundle = ["--bundle", str(painted_bundle)] if words[0] == "run" else []
    with pytest.raises(SystemExit) as ended:
        main([*words, "--camera", str(pictures), *bundle])
    assert ended.value.code == 4
    assert f"(No space left on device); {left}" in capsys.readouterr().err
    assert not bundle or load_map(tmp_path / "run")[0].count > 0


def test_a_run_whose_report_cannot_be_written_keeps_its_map_and_ends_with_an_error(
    edgemap, pictures, painted_bundle, tmp_path
):
    (tmp_path / "run" / "report.html").mkdir(parents=True)
    done = edgemap("run", "--camera", pictures, "--bundle", painted_bundle, "--out", tmp_path / "run")
    assert (done.returncode, load_map(tmp_path / "run")[0].count > 0) == (1, True)
    assert re.search(r"report\.html: cannot be written \(.*\)$", done.stderr.strip())


def test_ctrl_c_ends_a_recording_properly(started, tmp_path, pictures):
    picture = np.random.default_rng(0).integers(0, 255, (480, 640, 3), dtype=np.uint8)  # fills a chunk by itself
    cv2.imwrite(str(pictures / "0.png"), picture)
    for index in range(1, 300):  # half a minute
        (pictures / f"{index}.png").unlink(missing_ok=True)
        (pictures / f"{index}.png").symlink_to("0.png")
    (pictures / "camera.yaml").unlink()
    out = tmp_path / "a.mcap"
    process = started("record", "--camera", pictures, "-o", out, "--realtime", "--lossless")
    while process.poll() is None and not (out.exists() and out.stat().st_size > picture.size // 2):
        time.sleep(0.02)
    process.send_signal(signal.SIGINT)
    said, _ = process.communicate(timeout=120)
    assert process.returncode == 0
    with open_camera(str(out)) as camera:
        count = camera.info.frame_count or 0
        assert 0 < count < 300
        assert f"{count} pictures" in said
        for _ in range(count):
            assert camera.read() is not None
        assert camera.read() is None  # and no word of a cut


def test_ctrl_c_before_the_first_picture_leaves_no_empty_recording(tmp_path, pictures, monkeypatch):
    monkeypatch.setattr("edgemap.runtime.frames.camera.next_frame", lambda *_: None)
    with pytest.raises(BridgeError, match="before the first picture"):
        record(tmp_path / "a.mcap", Source(camera=str(pictures)))
    assert not (tmp_path / "a.mcap").exists()
