"""Decides whether a camera is carried or rides on wheels, from how much it swings and from a room's edges."""

import math
from dataclasses import dataclass, field, replace

from edgemap.geometry.camera.mount_tilt import MountTiltRule


@dataclass(frozen=True, slots=True)
class CarriedRule:
    """When a camera counts as carried."""

    # Weight of the newest picture in the running mean square of the tilt's change between pictures (rendered robots 0.2
    # to 0.3 degrees, two head cameras 1.6 to 1.8).
    share: float = 0.1
    # Path lengths without nodding after which a camera counts as one on wheels: the first where it nods by less than a
    # third of a robot's nodding, else the second (level robots 0.05 to 0.2 degrees; a walker begins with 0.4 to 0.5,
    # for 1.5 m).
    steady_m: tuple[float, float] = (0.5, 2.0)
    # Highest rate of a camera on a robot, and lowest of one that is certainly carried (rendered robots 1 to 4 degrees a
    # second, a hand-held camera 6, two head cameras 16 to 18).
    rate_rad_s: tuple[float, float] = (math.radians(5.0), math.radians(8.0))
    rate_s: float = 5.0  # averaging window of the rate; a camera counts as calm for two pictures before the first one


@dataclass(frozen=True, slots=True)
class Carried:
    """The estimate so far; call `updated` once per picture.

    nod_rad: nodding of a robot (`MountTiltRule.nod`); a camera whose tilt changes more is carried. nodding2: mean
    square of the tilt's change from picture to picture, rad^2. rate2: of its rate, rad^2/s^2, over
    judged_s. steady_m: path length since its nodding last exceeded nod_rad. scattered: whether the tilt from a room's
    edges keeps changing, even where the camera swings slowly.
    """

    rule: CarriedRule = field(default_factory=CarriedRule)
    nod_rad: float = MountTiltRule().nod
    pictures: int = 0
    nodding2: float = 0.0
    rate2: float = 0.0
    judged_s: float = 0.0
    steady_m: float = 0.0
    scattered: bool = False

    def certain(self) -> "Carried":
        """The estimate for a camera that starts as carried."""
        return replace(self, rate2=self.rule.rate_rad_s[1] ** 2, judged_s=self.rule.rate_s)

    def updated(self, nod2: float, span_s: float, path_m: float, gyro: bool = False) -> "Carried":
        """The estimate after one more picture. nod2: mean square of the change of roll and pitch since the last one,
        span_s ago. gyro: whether a gyro measured the rotation, so that the first pictures count fully.
        """
        rule, judged_s = self.rule, self.judged_s + span_s
        share = max(rule.share, 1.0 / (3.0 + self.pictures) if gyro else 0.0)
        nodding2 = self.nodding2 + share * (nod2 - self.nodding2)
        rate_share = min(span_s / min(judged_s + 3.0 * span_s, rule.rate_s), 1.0)
        return replace(
            self,
            pictures=self.pictures + 1,
            nodding2=nodding2,
            rate2=self.rate2 + rate_share * (nod2 / span_s**2 - self.rate2),
            judged_s=judged_s,
            steady_m=0.0 if math.sqrt(nodding2) > self.nod_rad else self.steady_m + path_m,
        )

    @property
    def nodding_rad(self) -> float:
        """Root mean square of the tilt's change between pictures, rad."""
        return math.sqrt(self.nodding2)

    @property
    def on_wheels(self) -> bool:
        """Whether it has moved `steady_m` without nodding like a carried camera."""
        needed_m = self.rule.steady_m[0 if self.nodding_rad < self.nod_rad / 3.0 else 1]
        return self.steady_m > needed_m and not self.scattered

    @property
    def share(self) -> float:
        """From 0, of a camera on a robot, to 1, of one that is carried."""
        level, carried = self.rule.rate_rad_s
        return 1.0 if self.scattered else min(max((math.sqrt(self.rate2) - level) / (carried - level), 0.0), 1.0)

    @property
    def carried(self) -> bool:
        """Whether it counts as carried rather than as on a robot."""
        return self.share > 0.5
