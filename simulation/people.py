"""People who walk about the home while the robot drives: smooth paths, some stops, never into the robot."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from edgemap.simulation.apartment.furniture import Model
from edgemap.simulation.errors import SimulationError
from edgemap.simulation.render.mesh import Array
from edgemap.simulation.robot import motion
from edgemap.simulation.robot.motion import SAMPLE_S, Limits, Sampled
from edgemap.simulation.robot.plan_grid import PlanGrid
from edgemap.simulation.robot.router import Router

# A person is this wide and keeps this far from the robot's middle.
_RADIUS_M, _APART_M = 0.22, 0.75
_TRIES = 12
_STAND_S = (0.5, 4.0)


@dataclass(frozen=True, slots=True, eq=False)
class Walker:
    """A person: of which model, and its pose in the home at any time."""

    model: Model
    motion: Sampled


def draw_walkers(
    grid: PlanGrid, models: Sequence[Model], count: int, robot: Sampled, seconds: float, seed: tuple[int, ...]
) -> tuple[Walker, ...]:
    """Draws `count` walkers for a span of time; fewer where there is no space. robot: the robot's drive, slightly
    longer.
    """
    walkers = []
    for number in range(count):
        rng = np.random.default_rng([*seed, number])
        limits = Limits(_RADIUS_M, 0.05, rng.uniform(0.6, 1.1), 0.9, 2.2, 5.0)
        try:
            router = Router(grid, limits)
        except SimulationError:
            break
        model = models[int(rng.integers(len(models)))]
        walkers.append(Walker(model, _walk(router, limits, robot, seconds, rng)))
    return tuple(walkers)


def _walk(router: Router, limits: Limits, robot: Sampled, seconds: float, rng: np.random.Generator) -> Sampled:
    starts = router.nodes_m[rng.integers(len(router.nodes_m), size=30)]
    far = np.linalg.norm(starts - robot.samples[0, :2], axis=1)
    pose = np.array([*starts[int(np.argmax(far > min(1.5, far.max() - 1e-9)))], rng.uniform(-math.pi, math.pi)])
    legs, count = [pose[None]], 1
    while count * SAMPLE_S < seconds:
        best: tuple[float, Array] | None = None
        for _ in range(_TRIES):
            leg = _draw_leg(router, limits, pose, rng)
            if leg is None:
                continue
            apart = _apart_m(leg, count, robot)
            if best is None or apart > best[0]:
                best = apart, leg
            if apart > _APART_M:
                break
        leg = best[1] if best is not None else motion.stand(pose, 1.0)
        legs.append(leg)
        count += len(leg)
        pose = leg[-1]
    return Sampled(np.concatenate(legs))


def _draw_leg(router: Router, limits: Limits, pose: Array, rng: np.random.Generator) -> Array | None:
    """Stand a while, or turn and walk somewhere."""
    if rng.random() < 0.3:
        return motion.stand(pose, rng.uniform(*_STAND_S))
    cost, before = router.reach(router.nearest(pose[:2]))
    goal = int(rng.integers(len(cost)))
    if not 1.0 < cost[goal] < 15.0:
        return None
    path = router.rounded(np.concatenate([pose[None, :2], router.chain(before, goal)[1:]]))
    if path is None:
        return None
    left = float(motion.headings(path, pose[2])[0] - pose[2])
    return np.concatenate([motion.turn(pose, left, limits), motion.along(path, pose[2] + left, limits)])


def _apart_m(leg: Array, start: int, robot: Sampled) -> float:
    """The least distance to the robot while the leg lasts and two seconds on."""
    last = np.tile(leg[-1], (int(2.0 / SAMPLE_S), 1))
    person = np.concatenate([leg, last])[::5]
    rows = np.minimum(start + 5 * np.arange(len(person)), len(robot.samples) - 1)
    return float(np.linalg.norm(person[:, :2] - robot.samples[rows, :2], axis=1).min())
