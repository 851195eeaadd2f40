"""Several odometries fused into one: pictures, wheels and gyro fail in different ways."""

import math
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from edgemap.geometry.camera.attitude import Attitude
from edgemap.geometry.observations.detections import share_covered
from edgemap.geometry.odometry.consensus import MotionEstimate, consensus, fused
from edgemap.geometry.odometry.room_compass import CompassRule, RoomCompass
from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.faults import Fault, FaultKind
from edgemap.runtime.frames.frame import Frame
from edgemap.runtime.frames.timing import StreamTimer
from edgemap.runtime.motion.health import REPEATED_S, HealthRule
from edgemap.runtime.motion.odometry.coasting import LONGEST_DT_S, SHORTEST_DT_S, Coasting, CoastingRule
from edgemap.runtime.motion.odometry.protocol import (
    NO_PRIOR,
    FramePrior,
    Motion,
    Odometry,
    blind_motion,
    first_motion,
    no_motion,
    unknown_covariance,
)
from edgemap.runtime.motion.trust import WHEELS, TrustRule, WheelTrust
from edgemap.runtime.network.network import Tensors

UNKNOWN = np.diag(unknown_covariance())  # variances from which a motion is worth less than a guess
CAMERA = "camera"  # the source that judges the wheels
GYRO = "gyro"  # the source whose translation, if any, depends on the others; a device may lack it


@dataclass(frozen=True, slots=True)
class HybridRule:
    """Weights of the hybrid's sources."""

    # Factor on covariances, so that they agree with the errors: on those of pictures, twice on the gyro's, and on the
    # fused one, as errors of landmarks, of scale and of a wheel's radius last for seconds, so that sums over 1 to 10 s
    # vary more than independent steps would.
    covariance_scale: float = 2.0
    # A further factor for the camera where the share of the picture that stays plain while the rest moves reaches
    # `health.part_share`, as a cover and its edge do not move; raised to the power of covered share over that limit.
    # While people and animals cover that much, the camera is not compared with the wheels.
    covered_covariance_scale: float = 30.0
    trust: TrustRule = field(default_factory=TrustRule)  # in the wheels
    compass: CompassRule = field(default_factory=CompassRule)  # of the room's edges, which correct the heading

    def covariance_factor(self, source: str, covered: float, limit: float) -> float:
        """Factor on a source's covariance where this share of the picture is covered. limit: `health.part_share`."""
        if source == CAMERA and covered >= limit:
            return self.covariance_scale * self.covered_covariance_scale ** (covered / limit)
        return {CAMERA: self.covariance_scale, GYRO: self.covariance_scale**2}.get(source, 1.0)


class HybridOdometry(Odometry):
    """The fused motion of camera, wheels and gyro (`geometry.odometry.consensus`).

    A source that is blind, reports a fault or is not finite is left out until it measures again, and the fault names
    it; where none measures, the motion is a guess (`Coasting`). sources: by name, the most trusted first, one or more.
    health: from which covered share of a picture on the camera is in doubt.
    """

    name = "hybrid"

    def __init__(
        self,
        sources: Mapping[str, Odometry],
        rule: HybridRule | None = None,
        coasting: CoastingRule | None = None,
        health: HealthRule | None = None,
    ) -> None:
        self._sources = dict(sources)
        self._rule, self._coasting = rule or HybridRule(), Coasting(coasting)
        self._covered_limit = (health or HealthRule()).part_share
        self._has_gyro = False
        self._news = {name: StreamTimer(REPEATED_S) for name in self._sources}  # of their faults
        # Of the last step, of the last one in which the sources agreed, and of the last one in which any measured.
        self._last_s = self._agreed_s = self._fused_s = -math.inf
        self._compass, self._wheels = RoomCompass(self._rule.compass), WheelTrust(self._rule.trust)

    def step(self, frame: Frame, features: Tensors, prior: FramePrior = NO_PRIOR) -> Motion:
        """The fused motion since the last frame."""
        motions = {name: source.step(frame, features, prior) for name, source in self._sources.items()}
        height, width = frame.image.shape[:2]
        movers = share_covered(prior.movers, width, height)
        fused_motion = self._fused(frame.stamp_s, motions, prior.covered, movers)
        return self._corrected(frame.stamp_s, fused_motion, prior.attitude)

    def step_blind(self, stamp_s: float, reason: Fault | None, attitude: Attitude | None = None) -> Motion:
        """The motion by the sources that need no picture."""
        motions = {name: source.step_blind(stamp_s, reason, attitude) for name, source in self._sources.items()}
        return self._corrected(stamp_s, self._fused(stamp_s, motions), attitude)

    def still(self, stamp_s: float, attitude: Attitude | None) -> bool | None:
        """Whether every source that measures rest reports it; None where none measures it."""
        answers = [source.still(stamp_s, attitude) for source in self._sources.values()]
        answers = [answer for answer in answers if answer is not None]
        return all(answers) if answers else None

    def rest(self, stamp_s: float) -> Motion:
        """Every source rests."""
        for source in self._sources.values():
            source.rest(stamp_s)
        self._coasting.saw(SE2(), stamp_s)
        self._last_s = stamp_s
        return no_motion()

    def _fused(
        self, stamp_s: float, motions: Mapping[str, Motion], covered: float = 0.0, movers: float = 0.0
    ) -> Motion:
        """The motion of a step by those of the sources. covered: as of `FramePrior`; movers: share of the picture that
        people and animals cover."""
        motions, news = self._checked(stamp_s, motions)
        from_s, self._last_s = self._last_s, stamp_s
        if not math.isfinite(from_s):
            self._agreed_s = self._fused_s = stamp_s
            self._coasting.begin(stamp_s)
            return first_motion(*_distinct(fault for motion in motions.values() for fault in motion.faults))
        alive = self._estimates(motions, covered)
        wheels, camera = alive.get(WHEELS), alive.get(CAMERA)
        judges = max(covered, movers) < self._covered_limit
        faults = [self._wheels.judge(wheels, camera if judges else None, from_s, stamp_s), *news]
        alive = self._wheels.trusted(alive, camera is not None)
        others = {name: item for name, item in alive.items() if name != GYRO}
        if not others:
            guess = replace(self._coasting.guess(stamp_s, *_distinct(faults)), members=self._roles(alive, alive))
            if not alive:
                return guess
            estimate = fused(MotionEstimate(guess.motion.vector(), guess.covariance), alive[GYRO])
            return replace(guess, motion=SE2(*estimate.motion), covariance=estimate.covariance)
        estimate = consensus(alive)
        scale, conflict = self._lasting(estimate.conflict, stamp_s)
        moved, covariance = estimate.motion, scale * estimate.covariance
        rotation = next((motion.rotation for motion in motions.values() if motion.rotation is not None), None)
        self._coasting.saw(SE2(*moved), stamp_s, covariance)
        visual = None if len(others) == len(alive) else consensus(others)
        return Motion(
            SE2(*moved),
            covariance,
            _distinct([*faults, conflict]),
            members=self._roles(alive, estimate.sources),
            without_gyro=visual and (SE2(*visual.motion), visual.covariance),
            rotation=rotation,
            gap=any(motion.gap for motion in motions.values()),
            lengths=(float(camera.motion[0]), float(wheels.motion[0])) if camera and wheels else None,
        )

    def _estimates(self, motions: Mapping[str, Motion], covered: float) -> dict[str, MotionEstimate]:
        """The sources' measurements, with their factors on the covariance; without those less certain than a guess."""
        estimates: dict[str, MotionEstimate] = {}
        for name, motion in motions.items():
            covariance = self._rule.covariance_factor(name, covered, self._covered_limit) * motion.covariance
            if motion.measured and (name == GYRO or (np.diag(covariance) < UNKNOWN).all()):
                estimates[name] = MotionEstimate(motion.motion.vector(), covariance)
        return estimates

    def _lasting(self, conflict: str, stamp_s: float) -> tuple[float, Fault | None]:
        """Factor on the covariance of a step for errors that last longer, and the fault, where sources have disagreed
        for a while."""
        before_s, conflict_s = self._fused_s - self._agreed_s, stamp_s - self._agreed_s
        self._fused_s = stamp_s
        if not conflict:
            self._agreed_s = stamp_s
            return self._rule.covariance_scale, None
        # Who is wrong goes on being wrong: errors add up, not their squares, as in `Coasting`.
        factor = (before_s + conflict_s) / max(conflict_s - before_s, SHORTEST_DT_S)
        new = before_s < LONGEST_DT_S - SHORTEST_DT_S <= conflict_s  # wheels slip for less
        fault = Fault(FaultKind.DISAGREEMENT, f"hybrid odometry: {conflict}: they disagree")
        return factor, fault if new else None

    def _corrected(self, stamp_s: float, motion: Motion, attitude: Attitude | None) -> Motion:
        """The motion with its heading corrected by the room's edges."""
        (x_m, y_m, yaw_rad), yaw_rad2 = motion.motion.vector(), float(motion.covariance[2, 2])
        turned_rad = self._compass.update(stamp_s, yaw_rad, yaw_rad2, attitude and attitude.room)
        covariance = motion.covariance + np.diag([0.0, 0.0, turned_rad**2])
        heading = SE2(x_m, y_m, yaw_rad + turned_rad)
        return replace(motion, motion=heading, covariance=covariance, heading_rad2=self._compass.heading_rad2)

    def _roles(self, alive: Collection[str], used: Collection[str]) -> dict[str, str]:
        """The role of each source in a step, as of `Motion.members`."""
        return {n: "used" if n in used else "left_out" if n in alive else "blind" for n in self._sources}

    def _checked(self, stamp_s: float, motions: Mapping[str, Motion]) -> tuple[dict[str, Motion], list[Fault]]:
        """The motions, those that are invalid as blind ones, and faults that are new or were last reported a while ago.
        A gyro that has never measured is none."""
        checked = {name: motion.checked(self._sources[name].name) for name, motion in motions.items()}
        if GYRO in checked:
            self._has_gyro |= checked[GYRO].measured
            checked[GYRO] = checked[GYRO] if self._has_gyro else blind_motion()
        news: list[Fault] = []
        for name, motion in checked.items():
            if not motion.faults:
                self._news[name].done()
            elif self._news[name].due(stamp_s):
                news += motion.faults
        return checked, news


def _distinct(faults: Iterable[Fault | None]) -> tuple[Fault, ...]:
    """Each fault once."""
    return tuple(dict.fromkeys(filter(None, faults)))
