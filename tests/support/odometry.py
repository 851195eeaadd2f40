"""An odometry for tests: its motions are given, and what it is asked is kept."""

from edgemap.runtime.motion.odometry.protocol import Odometry


class MadeOdometry(Odometry):
    """A subclass has `step`. A step without a picture fails the test unless it is overridden."""

    name = "made"

    def step_blind(self, stamp_s, reason, attitude=None):
        raise AssertionError(reason)
