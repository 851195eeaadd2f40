import numpy as np
import pytest
from support.made_camera import MadeCamera
from support.noise import noise
from support.odometry import MadeOdometry

from edgemap.benchmarks.odometry import follow
from edgemap.geometry.camera.floor import FloorCamera
from edgemap.geometry.camera.intrinsics import Intrinsics
from edgemap.geometry.camera.mount import Mount
from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.errors import OdometryError
from edgemap.runtime.frames.trajectory import Trajectory
from edgemap.runtime.motion.odometry.protocol import Motion, MotionState
from edgemap.runtime.network.bundle import load_bundle
from edgemap.runtime.network.store import bundle_folder
from edgemap.runtime.step.pipeline import Pipeline

COUNT = 12
LENS = FloorCamera(Intrinsics(64, 48, 60.0, 60.0, 31.5, 23.5), Mount.from_degrees(0.5, 15.0))


def straight(truth=True):
    """Ten pictures a second; the base goes 0.1 m a frame from (5, 5), looking along y."""
    poses = tuple(SE2(5, 5 + 0.1 * i, np.pi / 2) for i in range(COUNT))
    way = Trajectory(np.arange(COUNT) / 10, poses) if truth else None
    return MadeCamera(COUNT, lambda index: noise(index, (48, 64, 3)), name="straight", truth=way)


class Reader(MadeOdometry):
    """Says 0.2 m ahead each time, and remembers what it was fed."""

    name = "reader"

    def __init__(self, fault_at=None):
        self.seen, self.fault_at = [], fault_at

    def step(self, frame, features, prior=None):
        assert features
        self.seen.append((frame.index, frame.stamp_s))
        state = MotionState.BLIND if frame.index == self.fault_at else MotionState.MEASURED
        return Motion(SE2(0.2, 0, 0), np.eye(3) * len(self.seen), state=state)

    def rest(self, stamp_s):
        raise AssertionError(stamp_s)

    def reset(self, reason):
        raise AssertionError(reason)


def front_end(reader):
    return Pipeline(load_bundle(bundle_folder("edgemap-nano"), 1), LENS, reader)


def test_every_third_frame_from_the_second_on_and_no_more_than_asked():
    reader, done = Reader(fault_at=2), []
    found = follow(straight(), front_end(reader), first=1, every=3, frames=3, progress=lambda: done.append(1))
    assert found.indices == (1, 4, 7)
    assert reader.seen == [(0, 0.1), (1, 0.4), (2, pytest.approx(0.7))]
    assert [pose.x_m for pose in found.true] == pytest.approx([0.0, 0.3, 0.6])
    assert [pose.y_m for pose in found.true] == pytest.approx([0.0, 0.0, 0.0])
    # The first motion is not one: the odometry has nothing to compare with.
    assert [pose.x_m for pose in found.estimated] == pytest.approx([0.0, 0.2, 0.4])
    np.testing.assert_array_equal(found.covariances, [np.eye(3) * 2, np.eye(3) * 3])
    assert (found.faults, len(done)) == (1, 3)
    assert [dict(step) for step in found.members] == [{"reader": "used"}, {"reader": "blind"}]


def test_what_cannot_be_compared_is_refused():
    with pytest.raises(OdometryError, match="straight brings no true poses"):
        follow(straight(truth=False), front_end(Reader()))
    with pytest.raises(OdometryError, match="1 frames from frame 11 on"):
        follow(straight(), front_end(Reader()), first=11)
