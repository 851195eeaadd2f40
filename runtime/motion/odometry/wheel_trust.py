"""Whether the hybrid trusts its wheels, by comparing them with the camera."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from edgemap.geometry.odometry.covariance_intersection import MotionEstimate, difference
from edgemap.runtime.motion.trust import Innovation, SourceTrust, Trust, TrustRule

WHEELS = "wheels"  # the source
UNPROVEN = np.array([100.0, 100.0, 10.0])  # variances added to quantities that a source has not confirmed yet


class WheelTrust:
    """Judges wheels by yaw and length, and by how far they and the camera differ beyond what both state."""

    def __init__(self, rule: TrustRule) -> None:
        self._trust, self._innovation = SourceTrust.of(WHEELS, rule), Innovation()

    @property
    def scale(self) -> float:
        """Factor on the fused covariance."""
        return self._innovation.scale

    def judge(self, wheels: MotionEstimate | None, camera: MotionEstimate | None, dt_s: float) -> str:
        """Compare one step; a fault in the step in which the trust in the wheels changes."""
        trust = self._trust
        if wheels is None or camera is None:
            self._trust = trust.restarted()
            return ""
        (x_m, _, yaw_rad), (camera_m, _, camera_rad) = wheels.motion.tolist(), camera.motion.tolist()
        together = np.asarray(camera.covariance + wheels.covariance)
        yaw = trust.yaw.updated(yaw_rad, camera_rad, float(together[2, 2]))
        length = trust.length.updated(x_m, camera_m, float(together[0, 0]))
        self._trust, fault = replace(trust, yaw=yaw, length=length).news()
        if self._trust.distrusted:
            self._innovation = Innovation()  # the difference from a faulty source is no error of the others
        else:
            self._innovation = self._innovation.updated(difference(camera, wheels), together, dt_s)
        return fault

    def trusted(self, estimates: Sequence[MotionEstimate], camera: bool) -> list[MotionEstimate]:
        """The estimates without distrusted wheels. Beside the camera, quantities of the wheels that have not been
        confirmed yet have no weight."""
        trust = self._trust
        if trust.distrusted:
            return [item for item in estimates if item.source != WHEELS]
        proved = [part.state is Trust.TRUSTED and not trust.doubted for part in (trust.length, trust.yaw)]
        if not camera or all(proved):
            return list(estimates)
        loose = np.diag(np.where([proved[0], proved[0], proved[1]], 0.0, UNPROVEN))
        return [
            replace(item, covariance=item.covariance + loose) if item.source == WHEELS else item for item in estimates
        ]
