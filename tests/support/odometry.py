"""An odometry for tests: its motions are given, and what it is asked is kept."""

from edgemap.runtime.motion.odometry.protocol import no_motion


class MadeOdometry:
    """A subclass has `step`. A step without a picture fails the test unless it is overridden."""

    name, needs_features = "made", False

    def step_blind(self, stamp_s, reason, attitude=None):
        raise AssertionError(reason)

    def still(self, stamp_s, attitude):
        return None

    def rest(self, stamp_s):
        return no_motion()
