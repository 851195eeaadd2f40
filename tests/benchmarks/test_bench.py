import numpy as np
import pytest

from edgemap.benchmarks.bench import RING, compare, read_ring
from edgemap.runtime.cameras.base import CameraBase
from edgemap.runtime.errors import CameraError
from edgemap.runtime.frame import Frame


class Counting(CameraBase):
    """Frames that carry their number in their first pixel."""

    def __init__(self, count):
        super().__init__("counting")
        self.left = count
        self.size: tuple[int, int] = (4, 4)
        self.rate_hz: float | None = 20.0

    def read(self):
        if self.left == 0:
            return None
        self.left -= 1
        return self.frame(np.full((4, 4, 3), self._delivered, np.uint8), self._delivered / 20, "x")


def first_of(camera) -> Frame:
    frame = camera.read()
    assert frame is not None
    return frame


def test_the_ring_goes_forwards_and_backwards_with_fresh_numbers_and_stamps():
    camera = Counting(4)
    frames = read_ring(camera, first_of(camera)).cycle()
    taken = [next(frames) for _ in range(10)]
    assert [int(frame.image[0, 0, 0]) for frame in taken] == [0, 1, 2, 3, 2, 1, 0, 1, 2, 3]
    assert [frame.index for frame in taken] == list(range(10))
    assert [frame.stamp_s for frame in taken] == pytest.approx([i / 20 for i in range(10)])


def test_the_ring_holds_no_more_than_its_size():
    camera = Counting(200)
    assert len(read_ring(camera, first_of(camera)).frames) == RING


def test_one_frame_is_too_few():
    camera = Counting(1)
    with pytest.raises(CameraError, match="two frames or more, counting gave 1"):
        read_ring(camera, first_of(camera))


def test_ratios_are_ours_over_theirs(monkeypatch):
    """A clock that only our calls move: theirs twice as slow as ours."""
    import edgemap.benchmarks.bench as bench

    now = [0.0]

    def spend(seconds):
        now[0] += seconds

    monkeypatch.setattr(bench.time, "perf_counter", lambda: now[0])
    monkeypatch.setattr(bench.time, "sleep", lambda _: None)
    camera = Counting(5)
    ratios = compare(
        lambda image: spend(0.01), lambda frame: spend(0.015), lambda image: spend(0.02),
        (lambda: spend(0.004), lambda: spend(0.005)), read_ring(camera, first_of(camera)), 1.0,
    )  # fmt: skip
    assert (ratios["network_ratio"], ratios["end_to_end_ratio"], ratios["full_ratio"]) == (0.8, 0.5, 0.75)
