"""A simulated world: a furnished home with its light, a robot's path through it, and the camera on the robot.

Everything follows from the seed. What is drawn and how far stands in `simulation.envelope`.
"""

from dataclasses import dataclass, replace

import numpy as np

from edgemap.geometry.camera.mount import Mount
from edgemap.geometry.se2 import SE2
from edgemap.simulation.apartment import furniture
from edgemap.simulation.apartment.apartment import Apartment, Changes, furnish, move_furniture, purpose_of
from edgemap.simulation.apartment.furniture import Model
from edgemap.simulation.apartment.shell import build_shell
from edgemap.simulation.camera.exposure import LightScript
from edgemap.simulation.camera.film import CameraSetup, Effects
from edgemap.simulation.envelope import Envelope, light_of
from edgemap.simulation.errors import SimulationError
from edgemap.simulation.people import Walker, draw_walkers
from edgemap.simulation.render.mesh import placed
from edgemap.simulation.render.scene import Scene
from edgemap.simulation.robot.explore import Habits, drive
from edgemap.simulation.robot.motion import Limits, Sampled
from edgemap.simulation.robot.nodding import nodding_of
from edgemap.simulation.robot.plan_grid import PlanGrid, VisibilityEstimate

# What a drive must offer within its first 45 s, estimated from the plan: a little more than the contract asks, because
# the plan's estimate of what is seen is one. Judged on every n-th of 450 moments, whatever the camera's rate.
CONTRACT_STAMPS_S = np.arange(450) / 10.0
_CONTRACT_S = 45.0
_LEAST_ROOMS, _LEAST_WAY_M, _LEAST_OBJECTS = 2, 15.3, 13
_EVERY, _SEEN_SHARE, _LEAST_SEEN = 3, 0.45, 15
# Homes and drives in each that are tried for one seed. Substitutes come from the seed's own hundred, so that the homes
# of training, validation and test seeds never mix.
_HOMES, _DRIVES = 30, 6
_BLOCK, _STRIDE = 100, 37
_SPARE_S = 40.0
_ENVELOPE = Envelope()


@dataclass(frozen=True, slots=True)
class Choices:
    """Choices of the user; None is drawn from the seed. contract: whether the world must meet the guarantees of
    `sim:SEED`.

    rate_hz: of the camera.
    nodding: whether the robot nods. imu: whether an IMU is beside the lens.
    moved: so many pieces are removed from the seed's home and as many put elsewhere, and another way is driven.
    """

    camera: CameraSetup | None = None
    mount: Mount | None = None
    rate_hz: float | None = None
    effects: Effects | None = None
    light: str | None = None
    people: int | None = None
    limits: Limits | None = None
    habits: Habits | None = None
    contract: bool = True
    moved: int = 0
    nodding: bool = False
    imu: bool = False


PLAIN = Choices(CameraSetup(), effects=Effects(), light="day", people=0)


@dataclass(frozen=True, slots=True, eq=False)
class World:
    """All that a seed determines. home_seed: of the home, which is the seed's own or one of its substitutes'.

    tilts: of a base that nods, None of a level one. imu: whether its samples are recorded.
    changes: what was moved since the seed's own drive, start_before: where that one starts, in the home frame.
    """

    seed: int
    home_seed: int
    apartment: Apartment
    camera: CameraSetup
    effects: Effects
    light: LightScript
    motion: Sampled
    frames: int
    walkers: tuple[Walker, ...] = ()
    changes: Changes | None = None
    start_before: SE2 | None = None
    tilts: Sampled | None = None
    imu: bool = False

    @property
    def stamps_s(self) -> np.ndarray:
        """Middles of the exposures, (frames,)."""
        return np.arange(self.frames) / self.camera.rate_hz

    def models(self) -> list[Model]:
        """All furniture models and people of the world, for the credits."""
        return [item.model for item in (*self.apartment.furniture, *self.walkers)]

    def poses(self) -> list[SE2]:
        """Poses of the base in the home frame, one per picture."""
        return [SE2(*row) for row in self.motion.at(self.stamps_s)]


def build_scene(apartment: Apartment, seed: int) -> Scene:
    """Everything to light and draw, ids as in `apartment.furniture`."""
    shell = build_shell(apartment.before or apartment, np.random.default_rng([seed, 1]))
    pieces = {
        item.id: placed(furniture.piece(item.model, item.tint), item.pose_home_object, item.z_m)
        for item in apartment.furniture
    }
    return replace(shell, solids=shell.solids | pieces)


def draw_world(seed: int, frames: int, choices: Choices | None = None) -> World:
    """The world of a seed: the first home, camera and drive, in a fixed order, that offer what the contract asks.

    The contract is judged on the drive's first 45 s whatever `frames` is, and a drive is one endless stream, so
    a longer recording of a seed begins with the shorter one. Nodding and IMU have random streams of their own, so that
    everything else is as without them. Raises SimulationError where no try will do.
    """
    choices = choices or Choices()
    for attempt in range(_HOMES):
        home_seed = seed // _BLOCK * _BLOCK + (seed + _STRIDE * attempt) % _BLOCK
        apartment = furnish(home_seed)
        if choices.contract and len(apartment.plan.rooms) < _LEAST_ROOMS:
            continue
        grid = PlanGrid(apartment)
        for number in range(_DRIVES):
            seeds = seed, home_seed, number
            world = _draw_drive(seeds, frames, apartment, grid, choices)
            if world is None:
                continue
            if choices.moved:
                world = _after_moving(world, seeds, frames, choices)
            tilts = nodding_of(world.motion, (seed, home_seed, 8)) if choices.nodding else None
            return replace(world, tilts=tilts, imu=choices.imu)
    raise SimulationError(f"seed {seed}: none of {_HOMES} homes offers a drive of {_LEAST_WAY_M:.0f} m")


def _after_moving(before: World, seeds: tuple[int, int, int], frames: int, choices: Choices) -> World:
    """Another drive with the same camera, light and robot, through the home with some of its furniture moved."""
    seed, home_seed, _ = seeds
    eased = replace(choices, contract=False)
    for turn in range(1, _DRIVES + 1):
        rng = np.random.default_rng([seed, home_seed, choices.moved, turn, 6])
        apartment, changes = move_furniture(before.apartment, choices.moved, rng)
        world = _draw_drive(seeds, frames, apartment, PlanGrid(apartment), eased, turn)
        if world is not None:
            return replace(world, changes=changes, start_before=before.poses()[0])
    raise SimulationError(f"seed {seed}: no drive through its home with {choices.moved} pieces moved")


def _draw_drive(
    seeds: tuple[int, int, int], frames: int, apartment: Apartment, grid: PlanGrid, choices: Choices, *turn: int
) -> World | None:
    """seeds: the world's, the home's, and the number of the drive. turn: of the try after furniture was moved."""
    seed, home_seed, _ = seeds
    rng = np.random.default_rng([*seeds, 1])
    camera = choices.camera or _ENVELOPE.draw_camera(rng)
    camera = replace(camera, mount=choices.mount or camera.mount, rate_hz=choices.rate_hz or camera.rate_hz)
    light = light_of(choices.light, rng) if choices.light else _ENVELOPE.draw_light(rng)
    effects = choices.effects or _ENVELOPE.draw_effects(rng, light)
    limits = choices.limits or _ENVELOPE.draw_limits(rng)
    drawn = int(rng.choice(len(_ENVELOPE.people), p=_ENVELOPE.people))
    sight = VisibilityEstimate(apartment, grid, camera.intrinsics, camera.mount)
    way, seconds = [*seeds, 2, *turn], frames / camera.rate_hz
    try:
        motion = drive(sight, limits, np.random.default_rng(way), _CONTRACT_S, choices.habits)
        if choices.contract and not _fulfils(motion, sight):
            return None
        motion = drive(sight, limits, np.random.default_rng(way), seconds + _SPARE_S, choices.habits)
    except SimulationError:
        return None
    people = drawn if choices.people is None else choices.people
    models = furniture.people(purpose_of(home_seed))
    walkers = draw_walkers(grid, models, people, motion, seconds, (*seeds, 5, *turn))
    return World(seed, home_seed, apartment, camera, effects, light, motion, frames, walkers)


def _fulfils(motion: Sampled, sight: VisibilityEstimate) -> bool:
    poses = motion.at(CONTRACT_STAMPS_S)
    if np.linalg.norm(np.diff(poses[:, :2], axis=0), axis=1).sum() < _LEAST_WAY_M:
        return False
    seen = (sight.shares(poses[::_EVERY]) > _SEEN_SHARE).sum(axis=0) * _EVERY
    return int((seen >= _LEAST_SEEN).sum()) >= _LEAST_OBJECTS
