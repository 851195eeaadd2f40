"""A simulated world: a furnished room with its light, a way through it, and a camera that looks at the furniture."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from edgemap.geometry.intrinsics import Intrinsics
from edgemap.geometry.mount import Mount
from edgemap.geometry.se2 import SE2
from edgemap.simulation.apartment import furniture
from edgemap.simulation.apartment.apartment import Apartment, Placed
from edgemap.simulation.apartment.shell import build_shell
from edgemap.simulation.errors import SimulationError
from edgemap.simulation.render.mesh import Array
from edgemap.simulation.render.scene import Scene, Solid
from edgemap.simulation.render.view import View
from edgemap.simulation.robot.drive import FreeSpace, Limits, drive_along, random_way

# How well the camera sees a piece: not so near that the picture cuts it off, not so far that it is small.
_NEAREST_M, _FARTHEST_M = 1.3, 4.5
_FRAMES_TO_KNOW = 25

_INTRINSICS = Intrinsics(640, 480, 587.0, 587.0, 319.5, 239.5)
_MOUNT = Mount.from_degrees(0.60, 11.5, forward_m=0.15)


@dataclass(frozen=True, slots=True)
class CameraSetup:
    """The camera and how it is mounted; the default is the demo's."""

    intrinsics: Intrinsics = _INTRINSICS
    mount: Mount = _MOUNT
    rate_hz: float = 10.0


def build_scene(apartment: Apartment, seed: int) -> Scene:
    """Everything to light and draw, ids as in `apartment.furniture`."""
    shell = build_shell(apartment.shell, np.random.default_rng([seed, 1]))
    solids = tuple(Solid(item.id, furniture.load(item.model.key).placed(*_place(item))) for item in apartment.furniture)
    return Scene(shell.surfaces, (*shell.solids, *solids), shell.lights)


def plan_drive(
    apartment: Apartment, camera: CameraSetup, frames: int, seed: int, limits: Limits | None = None
) -> list[SE2]:
    """Poses of the base in the home frame, chosen among many random ways for what the camera sees on them.

    Raises SimulationError where no way fits the room and the time.
    """
    limits = limits or Limits()
    free, rng = FreeSpace(apartment), np.random.default_rng([seed, 2])
    best: tuple[float, list[SE2]] | None = None
    # Control points some 0.9 m apart, after what the spline cuts off.
    knots = max(5, round(frames / camera.rate_hz * limits.speed_m_s / 0.9))
    found = 0
    for _ in range(20000):
        way = random_way(free, limits, rng, knots)
        poses = None if way is None else drive_along(way, limits, frames, camera.rate_hz)
        if poses is None:
            continue
        found += 1
        score = way_score(apartment, free, camera, poses)
        if best is None or score > best[0]:
            best = score, poses
        if found >= 500:
            break
    if best is None:
        raise SimulationError(f"no way of {frames} frames through the room of seed {seed}")
    return best[1]


def way_score(apartment: Apartment, free: FreeSpace, camera: CameraSetup, poses: Sequence[SE2]) -> float:
    """Higher for ways that see every labelled piece often enough, see many at once, and don't stare at what is near."""
    sampled = poses[::4]
    seen = np.array([_seen(apartment, camera, pose) for pose in sampled])
    often = np.minimum(seen.sum(axis=0) * 4.0 / _FRAMES_TO_KNOW, 1.0)
    ahead = np.array([pose.apply([[d, 0.0] for d in (0.5, 0.8, 1.1)]) for pose in sampled])
    blocked = free.clearance_m(ahead.reshape(-1, 2)).reshape(-1, 3).min(axis=1) < 0.02
    few = (seen.sum(axis=1) < 3).mean()
    return float(2.0 * often.sum() + seen.sum(axis=1).mean() - 6.0 * few - 3.0 * blocked.mean())


def _seen(apartment: Apartment, camera: CameraSetup, pose_home_base: SE2) -> Array:
    """1 per labelled piece on the floor whose middle is well in view (whatever stands between), else 0."""
    items = [item for item in apartment.furniture if item.label and item.on_floor]
    middles = np.array(
        [[item.pose_home_object.x_m, item.pose_home_object.y_m, item.model.height_m / 2.0] for item in items]
    )
    optical = View.of_base(pose_home_base, camera.mount).to_optical(middles)
    columns = camera.intrinsics.project(optical)[:, 0]
    inside = (columns > 0.06 * camera.intrinsics.width) & (columns < 0.94 * camera.intrinsics.width)
    return (inside & (optical[:, 2] > _NEAREST_M) & (optical[:, 2] < _FARTHEST_M)).astype(np.float64)


def _place(item: Placed) -> tuple[float, float, float, float]:
    pose = item.pose_home_object
    return pose.x_m, pose.y_m, item.z_m, pose.yaw_rad
