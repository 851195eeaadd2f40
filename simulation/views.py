"""Unrelated views of a home for training a detector: each with its own camera, light, sensor and passers-by."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from edgemap.geometry.se2 import SE2
from edgemap.simulation.apartment import furniture
from edgemap.simulation.apartment.apartment import Apartment, purpose_of
from edgemap.simulation.apartment.furniture import Model
from edgemap.simulation.camera.exposure import LightScript
from edgemap.simulation.camera.film import CameraSetup, Effects
from edgemap.simulation.envelope import CARRIED, Envelope
from edgemap.simulation.render.mesh import Array
from edgemap.simulation.render.movers import Mover
from edgemap.simulation.robot.plan_grid import CELL_M, PlanGrid, VisibilityEstimate
from edgemap.simulation.studio import FIRST_MOVER_ID

# Places tried for one picture; most pictures take the one that shows most of what was shown least.
_PLACES = 24
_UNCHOSEN = 0.08
_CLEAR_M = 0.22
_BEARINGS = 7  # in which floor is looked for
_JPEG_QUALITY = (85, 95)
# Passers-by: how often none, one or two are near, how near, and how far to the side of where the camera looks.
_PASSERS = (0.8, 0.15, 0.05)
_NEAR_M, _ASIDE_RAD = (0.8, 4.0), 0.5


@dataclass(frozen=True, slots=True, eq=False)
class Shown:
    """One view: where the base is and how fast it moves (forward m/s, left m/s, yaw rad/s), and what takes it.

    passers: passers-by and the keys of their models.
    """

    pose_home_base: SE2
    velocity: Array
    camera: CameraSetup
    effects: Effects
    light: LightScript
    passers: list[tuple[Mover, str]]


def draw_views(apartment: Apartment, seed: int, count: int, close: float = 0.0, carried: bool = False) -> list[Shown]:
    """Views of the home of a seed; of the last ones, a share `close`, little or no floor is in view. carried: by
    cameras that a person carries, not by a robot's."""
    envelope, grid = CARRIED if carried else Envelope(), PlanGrid(apartment)
    shown = np.zeros(len(apartment.furniture) + 1)
    views = []
    for number in range(count):
        rng = np.random.default_rng([seed, number, 6])
        camera = envelope.draw_camera(rng)
        light = envelope.draw_light(rng)
        effects = replace(envelope.draw_effects(rng, light), jpeg_quality=int(rng.integers(*_JPEG_QUALITY)))
        sight = VisibilityEstimate(apartment, grid, camera.intrinsics, camera.mount)
        near = number >= count - round(close * count)
        pose = _draw_close(grid, camera, rng) if near else _draw_pose(grid, sight, shown, rng)
        velocity = np.array([rng.uniform(0.0, 0.7), 0.0, rng.normal(0.0, 0.4)]) * (rng.random() < 0.7)
        passers = _draw_passers(grid, pose, furniture.people(purpose_of(seed)), rng)
        views.append(Shown(SE2(*pose), velocity, camera, effects, light, passers))
    return views


def _draw_poses(grid: PlanGrid, rng: np.random.Generator) -> Array:
    """Poses (_PLACES, 3) that are clear of everything."""
    places = np.zeros((0, 2))
    while len(places) < _PLACES:
        drawn = rng.uniform(0.0, 1.0, (4 * _PLACES, 2)) * grid.size_m
        places = np.concatenate([places, drawn[grid.clearance_m(drawn) > _CLEAR_M]])
    return np.column_stack([places[:_PLACES], rng.uniform(-math.pi, math.pi, _PLACES)])


def _draw_close(grid: PlanGrid, camera: CameraSetup, rng: np.random.Generator) -> Array:
    """The pose of some from which least floor is seen."""
    poses, lens, mount = _draw_poses(grid, rng), camera.intrinsics, camera.mount
    half, lowest = math.atan(lens.width / 2.0 / lens.fx), mount.pitch_rad + math.atan(lens.height / 2.0 / lens.fy)
    away = mount.forward_m + np.arange(0.0, grid.size_m.max(), CELL_M)
    bearings = poses[:, 2, None] + np.linspace(-half, half, _BEARINGS)
    steps = np.stack([np.cos(bearings), np.sin(bearings)], axis=-1)[:, :, None] * away[:, None]
    row, column = grid.cells_of(poses[:, None, None, :2] + steps)
    free = np.logical_and.accumulate(grid.tops_m[row, column] == 0.0, axis=2)
    seen = free & (away - mount.forward_m > mount.height_m / math.tan(lowest))
    return poses[int(np.argmin(seen.sum(axis=(1, 2))))]


def _draw_pose(grid: PlanGrid, sight: VisibilityEstimate, shown: Array, rng: np.random.Generator) -> Array:
    """A pose that shows furniture. shown: how many views show each piece so far, by id."""
    poses = _draw_poses(grid, rng)
    if rng.random() < _UNCHOSEN:
        return poses[0]
    # Half of them look at a piece of furniture, a little off the middle.
    if len(sight.ids):
        half = _PLACES // 2
        towards = sight.middles_m[rng.integers(len(sight.ids), size=half)] - poses[:half, :2]
        poses[:half, 2] = np.arctan2(towards[:, 1], towards[:, 0]) + rng.normal(0.0, 0.3, half)
    seen = sight.shares(poses) > 0.3
    best = int(np.argmax(seen @ (1.0 / (1.0 + shown[sight.ids])) + rng.uniform(0.0, 0.5, _PLACES)))
    shown[sight.ids[seen[best]]] += 1.0
    return poses[best]


def _draw_passers(
    grid: PlanGrid, pose: Array, models: Sequence[Model], rng: np.random.Generator
) -> list[tuple[Mover, str]]:
    passers = []
    for number in range(int(rng.choice(len(_PASSERS), p=_PASSERS))):
        for _ in range(10):
            bearing = pose[2] + rng.normal(0.0, _ASIDE_RAD)
            at = pose[:2] + rng.uniform(*_NEAR_M) * np.array([math.cos(bearing), math.sin(bearing)])
            if grid.clearance_m(at)[0] > _CLEAR_M:
                model = models[int(rng.integers(len(models)))]
                facing = SE2(float(at[0]), float(at[1]), rng.uniform(-math.pi, math.pi))
                passers.append((Mover(FIRST_MOVER_ID + number, furniture.piece(model), facing), model.key))
                break
    return passers
