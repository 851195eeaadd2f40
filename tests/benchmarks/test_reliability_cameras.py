"""The camera part of `make reliability`: its own rules on a few faults, with the real supervisor and no drive."""

import math
from itertools import pairwise

import numpy as np
import pytest
from reliability.faulty_camera import ACTING, PASSING, CaptureDriver, FaultyDriver, FaultyWorld, plan

from edgemap.runtime.frames.errors import CameraFault, FrameTimeout
from edgemap.runtime.inputs.cameras.live import LiveCamera


def world_of(kind, resets, seed=3):
    random = np.random.default_rng(seed)
    images = [random.integers(0, 255, (24, 32, 3), dtype=np.uint8) for _ in range(50)]
    faults = plan(random, 1, 2.0, 6.0)
    faults[0].kind = kind
    world = FaultyWorld([images[i % 50] for i in range(300)], [0.1 * i for i in range(300)], faults)
    camera = LiveCamera(FaultyDriver(world, CaptureDriver(world), resets), clock_s=world.clock_s, wait=world.wait)
    return world, camera


@pytest.mark.parametrize("resets", [True, False])
@pytest.mark.parametrize("kind", PASSING + ACTING)
def test_every_kind_of_fault_is_told_and_recovers(kind, resets):
    world, camera = world_of(kind, resets)
    fault, told, stamps = world.faults[0], [], []
    while not world.stop.is_set():
        try:
            stamps.append(camera.read().stamp_s)  # pyright: ignore[reportOptionalMemberAccess]
        except CameraFault as error:
            told.append(error.kind.value)
        except FrameTimeout:
            continue
    assert fault.begun
    assert fault.over
    assert told or kind in ("silent", "backwards")  # a silence within the stall limit is none
    assert (np.diff(stamps) > 0).all()
    assert all(map(math.isfinite, stamps))
    assert stamps[-1] > 28.0
    assert stamps[-1] == pytest.approx(29.8, abs=0.2)  # on the world's clock


def test_the_same_seed_plans_the_same_faults():
    first, second = (plan(np.random.default_rng(5), 10, 0.0, 60.0) for _ in range(2))
    assert [(f.kind, f.start_s, f.by_s) for f in first] == [(f.kind, f.start_s, f.by_s) for f in second]
    assert all(a.start_s < b.start_s for a, b in pairwise(first))
