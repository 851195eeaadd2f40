"""A robot that explores a home: it approaches furniture, passes it, rotates, reverses, and changes rooms.

Leg by leg: some goals are drawn, each with its path and its ending, and the leg that shows most of what was visible
least, for the time it takes, is driven. A drive is one endless stream: a longer one begins as the shorter one.
"""

import math
from dataclasses import dataclass

import numpy as np

from edgemap.geometry.se2 import wrap_angle
from edgemap.simulation.errors import SimulationError
from edgemap.simulation.render.mesh import Array
from edgemap.simulation.robot import motion
from edgemap.simulation.robot.motion import SAMPLE_S, Limits, Sampled
from edgemap.simulation.robot.plan_grid import VisibilityEstimate
from edgemap.simulation.robot.router import Router

_LEGS_TRIED = 16
# How often the camera looks while a leg is judged, and the share that counts as seen.
_LOOK_S, _SEEN = 0.4, 0.4
# A piece is known after about this much view, and half forgotten after the second time, so that long drives return.
_KNOWN_S, _FORGOTTEN_S = 2.5, 60.0
# Distance from a piece's middle at which the robot stops before it.
_APPROACH_M = (1.1, 2.2)
# A path may begin with a bend instead of a turn on the spot up to this angle, over this distance.
_BEND_RAD, _BEND_M = 1.9, 0.35
_SIT_BACK_M = (0.2, 0.45)


@dataclass(frozen=True, slots=True)
class Habits:
    """Probabilities of the robot's actions per leg."""

    to_room: float = 0.3
    over: float = 0.5
    face: float = 0.6
    look_about: float = 0.25
    pause: float = 0.2
    back_off: float = 0.2


def drive(
    sight: VisibilityEstimate, limits: Limits, rng: np.random.Generator, seconds: float, habits: Habits | None = None
) -> Sampled:
    """Explore for at least this long. Raises SimulationError where the home has no free floor, or no path leads on."""
    explorer = _Explorer(sight, limits, rng, habits or Habits())
    moves, needed = [explorer.pose[None]], math.ceil(seconds / SAMPLE_S)
    while needed > 0:
        moves.append(explorer.next_leg())
        needed -= len(moves[-1])
    return Sampled(np.concatenate(moves))


class _Explorer:
    def __init__(self, sight: VisibilityEstimate, limits: Limits, rng: np.random.Generator, habits: Habits) -> None:
        self._grid, self._sight, self._limits, self._rng, self._habits = sight.grid, sight, limits, rng, habits
        self._router = Router(self._grid, limits)
        self._seen_s = np.zeros(len(sight.ids))
        nodes = self._router.nodes_m[rng.integers(len(self._router.nodes_m), size=24)]
        starts = np.column_stack([nodes, rng.uniform(-math.pi, math.pi, len(nodes))]).astype(np.float64)
        shown = (sight.shares(starts) > _SEEN).sum(axis=1)
        self.pose = starts[int(np.argmax(shown))]

    def next_leg(self) -> Array:
        """The best of some legs from here, (N, 3)."""
        start = self._router.nearest(self.pose[:2])
        cost, before = self._router.reach(start)
        best: tuple[float, Array, Array] | None = None
        for attempt in range(6 * _LEGS_TRIED):
            if attempt >= _LEGS_TRIED and best is not None:
                break
            leg = self._draw_leg(cost, before)
            if leg is None:
                continue
            looks = leg[:: round(_LOOK_S / SAMPLE_S)]
            gained = (self._sight.shares(looks) > _SEEN).sum(axis=0) * _LOOK_S
            score = self._score(gained, looks, len(leg) * SAMPLE_S)
            if best is None or score > best[0]:
                best = score, leg, gained
        if best is None:
            raise SimulationError(f"the robot finds no path on from ({self.pose[0]:.2f}, {self.pose[1]:.2f}) m")
        _, leg, gained = best
        self._seen_s = self._seen_s * 0.5 ** (len(leg) * SAMPLE_S / _FORGOTTEN_S) + gained
        self.pose = leg[-1]
        return leg

    def _score(self, gained: Array, looks: Array, seconds: float) -> float:
        """News per second and distance travelled, less the time spent close to walls."""
        news = np.exp(-self._seen_s / _KNOWN_S) - np.exp(-(self._seen_s + gained) / _KNOWN_S)
        ahead = np.stack([np.cos(looks[:, 2]), np.sin(looks[:, 2])], axis=1)
        walls = self._grid.clearance_m(looks[:, :2] + 0.6 * ahead) < 0.05
        shown = gained.sum() / max(len(looks) * _LOOK_S, _LOOK_S)
        pace_m_s = np.linalg.norm(np.diff(looks[:, :2], axis=0), axis=1).sum() / seconds
        return float(
            10.0 * news.sum() / (seconds + 2.0) + 0.5 * min(shown, 4.0) + 5.0 * min(pace_m_s, 0.45) - 2.0 * walls.mean()
        )

    def _draw_leg(self, cost: Array, before: np.ndarray) -> Array | None:
        rng, habits = self._rng, self._habits
        subject = None
        if len(self._sight.ids) and rng.random() > habits.to_room:
            news = np.exp(-self._seen_s / _KNOWN_S) + 0.03
            subject = int(rng.choice(len(news), p=news / news.sum()))
            goal = self._draw_spot_before(subject)
        else:
            goal = int(rng.integers(len(self._router.nodes_m)))
        if goal is None or not 0.5 < cost[goal] < 30.0:
            return None
        chain = self._router.chain(before, goal)
        if rng.random() < habits.over:
            over = int(rng.integers(len(self._router.nodes_m)))
            if cost[over] < cost[goal] + 2.0:
                _, onward = self._router.reach(over)
                chain = np.concatenate([self._router.chain(before, over), self._router.chain(onward, goal)[1:]])
        if subject is not None:
            chain = np.concatenate([chain, self._last_steps(chain[-1], subject)])
        moves = self._follow(chain)
        if moves is None:
            return None
        return np.concatenate([*moves, *self._ending(moves[-1][-1], subject)])

    def _draw_spot_before(self, subject: int) -> int | None:
        """A node at a good distance from a piece, most likely with a view of it."""
        apart = self._sight.middles_m[subject] - self._router.nodes_m
        distance = np.linalg.norm(apart, axis=1)
        near = np.flatnonzero((distance > _APPROACH_M[0]) & (distance < _APPROACH_M[1]) & (self._router.room_m > 0.3))
        if not len(near):
            return None
        spots = self._rng.choice(near, size=min(6, len(near)), replace=False)
        yaw = np.arctan2(apart[spots, 1], apart[spots, 0])
        looks = np.column_stack([self._router.nodes_m[spots], yaw]).astype(np.float64)
        shares = self._sight.shares(looks)[:, subject]
        return int(spots[int(np.argmax(shares))])

    def _last_steps(self, goal_m: Array, subject: int) -> Array:
        """A little further towards a piece where there is room, (N, 2): so the path ends facing it."""
        apart = self._sight.middles_m[subject] - goal_m
        steps = goal_m + np.arange(0.1, 0.45, 0.1)[:, None] * apart / np.linalg.norm(apart)
        clear = self._grid.clearance_m(steps) > self._limits.radius_m + self._limits.margin_m + 0.05
        return steps[: int(np.argmin(clear)) if not clear.all() else len(steps)]

    def _follow(self, chain: Array) -> list[Array] | None:
        """A turn to the path's first direction, if any is left, then the path."""
        here, yaw = self.pose[:2], self.pose[2]
        points = np.concatenate([here[None], chain[1:] if len(chain) > 1 else chain])
        ahead = np.array([math.cos(yaw), math.sin(yaw)])
        look = points[min(len(points) - 1, 4)] - here
        off = abs(wrap_angle(math.atan2(look[1], look[0]) - yaw))
        path, far = None, np.linalg.norm(points - here, axis=1) > 1.6 * _BEND_M
        if off < _BEND_RAD and far.any():
            path = self._router.rounded(np.stack([here, here + _BEND_M * ahead, *points[1:][far[1:]]]))
        path = self._router.rounded(points) if path is None else path
        if path is None:
            return None
        left = float(motion.headings(path, yaw)[0] - yaw)
        moves = [motion.turn(self.pose, left, self._limits)] if abs(left) > 1e-4 else []
        return [*moves, motion.along(path, yaw + left, self._limits)]

    def _ending(self, pose: Array, subject: int | None) -> list[Array]:
        """What is done on arrival: face the piece, look about, stand, back off."""
        rng, habits, limits = self._rng, self._habits, self._limits
        moves: list[Array] = []

        def add(move: Array) -> None:
            nonlocal pose
            if len(move):
                moves.append(move)
                pose = move[-1]

        if subject is not None and rng.random() < habits.face:
            apart = self._sight.middles_m[subject] - pose[:2]
            add(motion.turn(pose, wrap_angle(math.atan2(apart[1], apart[0]) - pose[2] + rng.normal(0.0, 0.12)), limits))
        if rng.random() < habits.pause:
            add(motion.stand(pose, rng.uniform(0.3, 1.2)))
        if rng.random() < habits.look_about:
            side = rng.choice([-1.0, 1.0]) * rng.uniform(0.4, 1.0)
            add(motion.turn(pose, side, limits))
            if rng.random() < 0.4:
                add(motion.turn(pose, -side * rng.uniform(1.2, 2.0), limits))
        back_m = rng.uniform(*_SIT_BACK_M)
        if rng.random() < habits.back_off:
            ahead = np.array([math.cos(pose[2]), math.sin(pose[2])])
            behind = pose[:2] - np.linspace(0.05, back_m, 8)[:, None] * ahead
            if self._grid.clearance_m(behind).min() > limits.radius_m + limits.margin_m:
                add(motion.straight(pose, -back_m, limits))
        return moves
