"""The paper's private data set, rendered: a LoCoBot's RGB, depth and wheel odometry, to train on and to test on."""

from dataclasses import replace
from pathlib import Path

from edgemap.geometry.camera.intrinsics import Intrinsics
from edgemap.geometry.camera.mount import Mount
from edgemap.simulation.camera.film import CameraSetup, Effects
from edgemap.simulation.record import record
from edgemap.simulation.robot.explore import Habits
from edgemap.simulation.robot.motion import Limits
from edgemap.simulation.store import Progress
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


def drives(seed: int) -> list[tuple[str, int, Choices, int]]:
    """The training drives, each in a home of its own, and the four test drives, in homes with held-out furniture: the
    folder's name, the seed and the choices of the world, the number of pictures."""
    mixed = enumerate((SMOOTH, SHARP, SMOOTH, CHANGING, SMOOTH), start=1)
    tests = {"smooth-1": SMOOTH, "smooth-2": SMOOTH, "sharp-turns": SHARP, "changing-light": CHANGING}
    first = TEST_SEED + seed % 90
    training = [(f"training-{number}", seed + number, choices, TRAINING_FRAMES) for number, choices in mixed]
    return training + [(f"test-{name}", first + i, tests[name], TEST_FRAMES) for i, name in enumerate(tests)]


def record_locobot(
    folder: Path,
    seed: int,
    progress: Progress = lambda _done, _all: None,
    command: str = "edgemap simulate --locobot",
) -> None:
    """Write the set: `training-1` … `training-5` and `test-…`, each a folder for `--data locobot:DIR`.

    An interrupted rendering keeps its finished pictures. Raises SimulationError and MissingExtraError, one line each.
    """
    todo, before = drives(seed), 0
    total = sum(frames for *_, frames in todo)
    for name, home, choices, frames in todo:

        def shown(done: int, _: int, start: int = before) -> None:
            progress(start + done, total)

        record(draw_world(home, frames, choices), folder / name, layout="locobot", progress=shown, command=command)
        before += frames
