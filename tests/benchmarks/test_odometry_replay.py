import numpy as np
import pytest

from edgemap.benchmarks.odometry_replay import Features, follow
from edgemap.geometry.se2 import SE2
from edgemap.runtime.cameras.base import CameraBase
from edgemap.runtime.errors import OdometryError
from edgemap.runtime.odometry.protocol import Motion
from edgemap.runtime.trajectory import Trajectory

COUNT = 12


class Straight(CameraBase):
    """Ten pictures a second; the base goes 0.1 m a frame from (5, 5), looking along y."""

    def __init__(self, truth=True):
        super().__init__("straight")
        if truth:
            poses = tuple(SE2(5, 5 + 0.1 * i, np.pi / 2) for i in range(COUNT))
            self.truth: Trajectory | None = Trajectory(np.arange(COUNT) / 10, poses)

    def read(self):
        if self._delivered == COUNT:
            return None
        picture = np.random.default_rng(self._delivered).integers(0, 255, (48, 64, 3), dtype=np.uint8)
        return self.frame(picture, self._delivered / 10, "")


class Reader:
    """Says 0.2 m ahead each time, and remembers what it was fed; asks for features where wanted."""

    name, needs_features = "reader", False

    def __init__(self, feature=None, fault_at=None):
        self.seen, self.feature, self.fault_at = [], feature, fault_at

    def step(self, frame, features):
        self.seen.append((frame.index, frame.stamp_s))
        if self.feature:
            features[self.feature]
            features[self.feature]
        return Motion(SE2(0.2, 0, 0), np.eye(3) * len(self.seen), "lost" if frame.index == self.fault_at else "")

    def step_blind(self, stamp_s, reason, attitude=None):
        raise AssertionError(reason)

    def still(self, stamp_s, attitude):
        raise AssertionError(stamp_s)

    def rest(self, stamp_s):
        raise AssertionError(stamp_s)

    def reset(self, reason):
        raise AssertionError(reason)


def test_every_third_frame_from_the_second_on_and_no_more_than_asked():
    reader, done = Reader(fault_at=2), []
    found = follow(Straight(), reader, lambda frame: {}, first=1, every=3, frames=3, progress=lambda: done.append(1))
    assert found.indices == (1, 4, 7)
    assert reader.seen == [(0, 0.1), (1, 0.4), (2, pytest.approx(0.7))]
    assert [pose.x_m for pose in found.true] == pytest.approx([0.0, 0.3, 0.6])
    assert [pose.y_m for pose in found.true] == pytest.approx([0.0, 0.0, 0.0])
    # The first motion is not one: the odometry has nothing to compare with.
    assert [pose.x_m for pose in found.estimated] == pytest.approx([0.0, 0.2, 0.4])
    np.testing.assert_array_equal(found.covariances, [np.eye(3) * 2, np.eye(3) * 3])
    assert (found.faults, len(done)) == (1, 3)


@pytest.mark.parametrize(("feature", "runs"), [(None, 0), ("deep", COUNT)])
def test_the_backbone_runs_where_features_are_read_and_then_once(feature, runs):
    calls = []

    def compute():
        calls.append(1)
        return {"deep": np.zeros((1, 2), np.float32)}

    follow(Straight(), Reader(feature), lambda frame: Features(compute))
    assert len(calls) == runs


def test_a_feature_that_the_backbone_lacks_is_a_key_error():
    features = Features(lambda: {"deep": np.zeros((1, 2), np.float32)})
    with pytest.raises(KeyError, match="shallow"):
        features["shallow"]
    assert features["deep"].shape == (1, 2)


def test_what_cannot_be_compared_is_refused():
    with pytest.raises(OdometryError, match="straight brings no true poses"):
        follow(Straight(truth=False), Reader(), lambda frame: {})
    with pytest.raises(OdometryError, match="1 frames from frame 11 on"):
        follow(Straight(), Reader(), lambda frame: {}, first=11)


def test_features_that_nobody_asked_for_yet_are_features():
    """The hybrid lets its network sleep in frames without any."""
    asked = []
    features = Features(lambda: asked.append(1) or {"a": np.zeros(1, np.float32)})
    assert features
    assert not asked
    assert features["a"].shape == (1,)
