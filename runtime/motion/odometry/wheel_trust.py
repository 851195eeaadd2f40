"""Whether the hybrid trusts its wheels, by comparing them with the camera."""

from collections.abc import Mapping

import numpy as np

from edgemap.geometry.odometry.consensus import MotionEstimate, difference
from edgemap.runtime.frames.faults import Fault, FaultKind
from edgemap.runtime.motion.trust import Agreement, Innovation, Trust, TrustRule

WHEELS = "wheels"  # the source
UNPROVEN = np.array([100.0, 100.0, 10.0])  # variances added to quantities that a source has not confirmed yet


class WheelTrust:
    """Judges wheels by yaw and length, and by their difference from the camera beyond both covariances."""

    def __init__(self, rule: TrustRule) -> None:
        state = Trust.UNPROVEN if rule.windows else Trust.TRUSTED
        self._yaw, self._length = (Agreement(rule, least, state) for least in rule.least)
        self._innovation, self._excluded = Innovation(), False

    @property
    def scale(self) -> float:
        """Factor on the fused covariance."""
        return self._innovation.scale

    def judge(self, wheels: MotionEstimate | None, camera: MotionEstimate | None, dt_s: float) -> Fault | None:
        """Compare one step; a fault in the step from which on the wheels are excluded, or used again."""
        if wheels is None or camera is None:
            self._yaw, self._length = self._yaw.restarted(), self._length.restarted()
            return None
        (x_m, _, yaw_rad), (camera_m, _, camera_rad) = wheels.motion.tolist(), camera.motion.tolist()
        together = np.asarray(camera.covariance + wheels.covariance)
        self._yaw = self._yaw.updated(yaw_rad, camera_rad, float(together[2, 2]))
        self._length = self._length.updated(x_m, camera_m, float(together[0, 0]))
        wrong = [(name, part) for name, part in self._parts if part.state is Trust.DISTRUSTED]
        news, self._excluded = bool(wrong) != self._excluded, bool(wrong)
        if wrong:
            self._innovation = Innovation()  # the difference from a faulty source is no error of the others
        else:
            self._innovation = self._innovation.updated(difference(camera, wheels), together, dt_s)
        if not news:
            return None
        if not wrong:
            return Fault(FaultKind.WHEELS_RESTORED, f"{WHEELS}: agrees with the camera again: used again")
        name, part = wrong[0]
        text = f"{WHEELS}: its {name} is {100.0 * part.ratio:.0f} % of what the camera measures: left out"
        return Fault(FaultKind.WHEELS_EXCLUDED, text)

    def trusted(self, estimates: Mapping[str, MotionEstimate], camera: bool) -> dict[str, MotionEstimate]:
        """The estimates without distrusted wheels. With a camera, quantities of the wheels that have not been confirmed
        yet have no weight."""
        trusted = dict(estimates)
        wheels = trusted.pop(WHEELS, None)
        if wheels is None or self._excluded:
            return trusted
        doubted = self._yaw.doubted or self._length.doubted
        yaw, length = (part.state is Trust.TRUSTED and not doubted for _, part in self._parts)
        if camera and not (yaw and length):
            loose = np.diag(np.where([length, length, yaw], 0.0, UNPROVEN))
            wheels = MotionEstimate(wheels.motion, wheels.covariance + loose)
        return {name: wheels if name == WHEELS else item for name, item in estimates.items()}

    @property
    def _parts(self) -> tuple[tuple[str, Agreement], tuple[str, Agreement]]:
        """What is compared, by name."""
        return ("yaw", self._yaw), ("length", self._length)
