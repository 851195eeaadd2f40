"""Benchmarks: drives in order, processor time, ratios; maps side by side as each alone."""

import time
from functools import partial
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from support.made_camera import MadeCamera

from edgemap.benchmarks import rivals as contest
from edgemap.benchmarks.bench import CHUNK, WARM_UP, drive_chunks, measure
from edgemap.benchmarks.map_variants import remembering, replayed
from edgemap.benchmarks.rivals import picture_to_boxes
from edgemap.runtime.frames.errors import CameraError
from edgemap.runtime.inputs.drives import open_drive
from edgemap.runtime.inputs.open import DEMO, open_camera
from edgemap.runtime.network.bundle import load_bundle
from edgemap.runtime.network.decode import Decoder, Detector
from edgemap.runtime.network.store import bundle_folder
from edgemap.runtime.step.slam import SemanticSlam, SlamOptions


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
    networks = (lambda image: spend(0.01, 2), lambda image: spend(0.02, 3))
    whole = (lambda: spend(0.004), lambda: spend(0.005))
    ratios = contest.compare(networks, whole, lambda: (counting(5), Slam(lambda frame: spend(0.015))), 1.0)
    assert (ratios["network_ratio"], ratios["end_to_end_ratio"], ratios["full_ratio"]) == (0.8, 0.5, 0.75)
    assert ratios["cpu_ratio"] == pytest.approx(1 / 3, abs=1e-3)


@pytest.mark.parametrize("name", ["edgemap-nano", "yolox-nano", "edgemap-pico"])
def test_the_rivals_loop_finds_our_boxes(name):
    bundle = load_bundle(bundle_folder(name))
    spec = bundle.manifest.detector
    with open_camera("demo") as camera:
        frames = [camera.read() for _ in range(40)]

    def infer(tensor):
        found = bundle.backbone.run({spec.input.name: tensor})
        return [found[head.name] for head in spec.heads]

    theirs, ours = picture_to_boxes(spec, infer, 0.5), Detector(bundle, Decoder(spec, 0.5))
    both = 0
    for frame in frames[::8]:
        corners, scores, _ = theirs(frame.image)  # type: ignore[misc]
        found = ours(frame.image)
        assert len(scores) <= len(found)  # theirs suppresses across classes
        for corner, size, score in zip(corners[:, :2], corners[:, 2:], scores, strict=True):
            box = np.concatenate([corner, corner + size]).clip(0, [640, 480, 640, 480])
            both += bool((np.abs(found.boxes - box).max(axis=1) + 100 * np.abs(found.scores - score)).min() < 2.0)
    assert both > 0


@pytest.fixture(scope="module")
def demo():
    return open_drive(f"drive:{DEMO}"), load_bundle(bundle_folder("edgemap-nano"))


def places(slam):
    return {item.id: np.round(item.position_m, 9).tolist() for item in slam.objects()}


def test_side_by_side_is_the_same_as_alone(demo):
    """Each has an attitude, a tracker and a map of its own; they share the pictures and the backbone's outputs."""
    drive, bundle = demo
    variants = {"wheels": SlamOptions(), "none": SlamOptions(wheels=False), "true": SlamOptions("truth")}
    together = replayed(drive, bundle, variants, 16)
    assert places(together["wheels"]) != places(together["none"]) != places(together["true"])
    for name, variant in variants.items():
        assert places(replayed(drive, bundle, {name: variant}, 16)[name]) == places(together[name])


def test_a_remembered_picture_has_the_outputs_of_the_network(demo):
    _, bundle = demo
    kept = remembering(bundle).backbone
    tensors = kept.zeros()
    first, again, plain = kept.run(tensors), kept.run(tensors), bundle.backbone.run(tensors)
    for name, values in plain.items():
        np.testing.assert_array_equal(first[name], values)
        assert again[name] is first[name]
    other = {name: values + 1.0 for name, values in tensors.items()}
    found, plain = kept.run(other), bundle.backbone.run(other)
    assert all(np.array_equal(found[name], values) for name, values in plain.items())


def test_loops_close_only_where_poses_are_not_given():
    assert SlamOptions().closes_loops
    for options in (SlamOptions("truth"), SlamOptions("poses.tum"), SlamOptions("tf"), SlamOptions(loop_closure=False)):
        assert not options.closes_loops
