"""The paper's private data set, rendered: a LoCoBot's RGB, depth and wheel odometry, to train on and to test on."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

from edgemap.geometry.camera.intrinsics import Intrinsics
from edgemap.geometry.camera.mount import Mount
from edgemap.simulation.camera.film import CameraSetup, Effects
from edgemap.simulation.record import record
from edgemap.simulation.robot.explore import Habits
from edgemap.simulation.robot.motion import Limits
from edgemap.simulation.world import Choices, draw_world

# A RealSense D435 on a LoCoBot's mast, and its sensor at its everyday imperfection.
CAMERA = CameraSetup(
    Intrinsics(640, 480, 615.0, 615.0, 321.0, 238.5), Mount.from_degrees(0.58, 14.0, forward_m=0.05), rate_hz=10.0
)
EFFECTS = Effects(exposure_s=0.010, readout_s=0.012, shake_rad=0.002, shot=0.012, read=0.001, jpeg_quality=None)
SMOOTH = Choices(
    CAMERA,
    effects=EFFECTS,
    light="day",
    people=0,
    limits=Limits(0.18, 0.08, speed_m_s=0.45, yaw_rate_rad_s=0.7),
    habits=Habits(look_about=0.1, pause=0.1, back_off=0.1),
    contract=False,
)
SHARP = replace(
    SMOOTH,
    limits=Limits(0.18, 0.08, 0.6, 0.8, yaw_rate_rad_s=1.5, yaw_acceleration_rad_s2=5.0),
    habits=Habits(look_about=0.8, pause=0.1, back_off=0.35),
)
CHANGING = replace(SMOOTH, light="changing")
TRAINING_FRAMES, TEST_FRAMES = 1000, 2000  # of each drive
TEST_SEED = 9100


@dataclass(frozen=True, slots=True)
class DrivePart:
    """One drive of the set: its folder's name, the seed of its world, its pictures."""

    name: str
    seed: int
    choices: Choices
    frames: int


def parts(seed: int) -> list[DrivePart]:
    """The training drives, each in a home of its own, and the four test drives, in homes with held-out furniture."""
    mixed = (SMOOTH, SHARP, SMOOTH, CHANGING, SMOOTH)
    training = [
        DrivePart(f"training-{number}", seed + number, choices, TRAINING_FRAMES)
        for number, choices in enumerate(mixed, start=1)
    ]
    tests = (("smooth-1", SMOOTH), ("smooth-2", SMOOTH), ("sharp-turns", SHARP), ("changing-light", CHANGING))
    return training + [
        DrivePart(f"test-{name}", TEST_SEED + seed % 90 + number, choices, TEST_FRAMES)
        for number, (name, choices) in enumerate(tests)
    ]


def record_locobot(
    folder: Path,
    seed: int,
    progress: Callable[[int, int], None] = lambda _done, _all: None,
    command: str = "edgemap simulate --locobot",
) -> None:
    """Write the set: `training-1` … `training-5` and `test-…`, each a folder for `--data locobot:DIR`.

    An interrupted rendering keeps its finished pictures. Raises SimulationError and MissingExtraError, one line each.
    """
    todo = parts(seed)
    total, before = sum(part.frames for part in todo), 0
    for part in todo:
        world = draw_world(part.seed, part.frames, part.choices)
        start = before
        record(
            world,
            folder / part.name,
            layout="locobot",
            progress=lambda done, _, start=start: progress(start + done, total),
            command=command,
        )
        before += part.frames
