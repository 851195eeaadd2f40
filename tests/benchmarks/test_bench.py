import time
from functools import partial
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from support import painted
from support.made_camera import MadeCamera

from edgemap.benchmarks import rivals as contest
from edgemap.benchmarks.bench import CHUNK, WARM_UP, drive_chunks, measure
from edgemap.runtime.frames.errors import CameraError
from edgemap.runtime.step.slam import SemanticSlam


def counting(count):
    """Frames that carry their number in their first pixel."""
    picture = partial(np.full, (4, 4, 3), dtype=np.uint8)
    return MadeCamera(count, picture, rate_hz=20.0, name="counting", size=(4, 4))


class Slam(SemanticSlam):
    """Remembers the frames of its drive; a step takes what it is told on a clock of its own."""

    def __init__(self, step=lambda frame: None):
        self.seen, self._step = [], step

    def step(self, frame) -> Any:
        self.seen.append(int(frame.image[0, 0, 0]))
        self._step(frame)
        return SimpleNamespace(stages_ms={"all": 1.0}, observed=SimpleNamespace(at_rest=False, searched=True))

    def objects(self):
        return []


def test_drives_go_in_order_and_begin_again_with_an_empty_map():
    count = CHUNK + 5
    chunks = drive_chunks(lambda: (counting(count), Slam()))
    (first, a), (same, b), (other, c) = (next(chunks) for _ in range(3))
    assert first is same
    assert other is not first
    assert [int(frame.image[0, 0, 0]) for frame in [*a, *b]] == list(range(count))
    assert (int(c[0].image[0, 0, 0]), c[0].index) == (0, 0)


def test_a_source_of_one_frame_is_refused():
    with pytest.raises(CameraError, match="two frames or more, counting gave 1"):
        list(zip(range(2), drive_chunks(lambda: (counting(1), Slam())), strict=False))


def test_processor_time_is_counted_and_sleeping_is_not():
    def work(frame):
        end = time.process_time() + 0.004
        while time.process_time() < end:
            pass
        time.sleep(0.002)

    slams = []

    def open_drive():
        slams.append(Slam(work))
        return counting(60), slams[-1]

    found = measure(open_drive, 0.5, rate_hz=50.0)
    assert slams[0].seen == list(range(len(slams[0].seen)))
    assert sum(len(slam.seen) for slam in slams) == found["frames"] + WARM_UP
    assert 4.0 <= found["cpu_ms_per_frame"] < 6.0
    assert found["fps"] <= 50.5
    assert found["latency_ms"]["p50"] >= 6.0
    assert found["stages_cpu_ms"] == {"all": 1.0}


def test_ratios_are_ours_over_theirs(monkeypatch):
    """Clocks that only our calls move: theirs twice as slow as ours, and three times as thirsty."""
    now, burnt = [0.0], [0.0]

    def spend(seconds, threads=1):
        now[0] += seconds
        burnt[0] += seconds * threads

    monkeypatch.setattr(contest.time, "perf_counter", lambda: now[0])
    monkeypatch.setattr(contest.time, "process_time", lambda: burnt[0])
    monkeypatch.setattr(contest.time, "sleep", lambda _: None)
    ratios = contest.compare(
        (lambda image: spend(0.01, 2), lambda image: spend(0.02, 3)),
        (lambda: spend(0.004), lambda: spend(0.005)),
        lambda: (counting(5), Slam(lambda frame: spend(0.015))),
        1.0,
    )
    assert (ratios["network_ratio"], ratios["end_to_end_ratio"], ratios["full_ratio"]) == (0.8, 0.5, 0.75)
    assert ratios["cpu_ratio"] == pytest.approx(1 / 3, abs=1e-3)


def test_the_floor_head_is_timed_apart_from_its_backbone(tmp_path):
    from edgemap.benchmarks.bench import floor_head_ms
    from edgemap.runtime.network.bundle import load_bundle
    from edgemap.runtime.network.store import bundle_folder

    bundle = load_bundle(bundle_folder("edgemap-nano"), 1).for_pictures(640, 480)
    before = time.process_time()
    bundle.backbone.run(bundle.backbone.zeros())
    whole_ms = 1e3 * (time.process_time() - before)
    head_ms = floor_head_ms(bundle)
    assert head_ms is not None
    assert 0.1 < head_ms < whole_ms / 3.0
    assert floor_head_ms(load_bundle(painted.write_painted(tmp_path / "b", []), 1)) is None
