"""`sim:SEED` as a camera and as data: only the command line imports both runtime and simulation."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from edgemap.cli.arguments import OptionError

if TYPE_CHECKING:
    from edgemap.runtime.inputs.cameras.protocol import Camera
    from edgemap.runtime.inputs.drives.camera_yaml import CameraFile
    from edgemap.simulation.live import SimCamera

PREFIX = "sim:"
RENDERERS = ("moderngl", "embreex", "PIL")  # what rendering needs of the extra `simulation`
SEED_DIGITS = 18


def open_simulated(
    spec: str, frames: int | None = None, realtime: bool = False, described: "CameraFile | None" = None
) -> "Camera":
    """The camera of `sim:SEED` for a run. A camera file's lens and mount go before its own."""
    camera = simulated(spec, frames)
    if described is not None:
        camera.intrinsics, camera.mount = described.intrinsics, described.mount or camera.mount
    if not realtime:
        return camera
    from edgemap.runtime.inputs.cameras.wrappers import PacedCamera

    return PacedCamera(camera)


def simulated(spec: str, frames: int | None = None) -> "SimCamera":
    """The world of `sim:SEED` as a camera; 450 frames unless --frames is given.

    Raises OptionError for a seed that is no number, and MissingExtraError where the extra is missing.
    """
    from edgemap.runtime.frames.extras import need

    seed = spec.removeprefix(PREFIX)
    if not seed.isdecimal() or len(seed) > SEED_DIGITS:
        raise OptionError(f"camera {spec!r}: expected sim:SEED with a whole number, 0 or more")
    need("simulation", spec, RENDERERS)
    from edgemap.simulation.live import open_sim

    return open_sim(int(seed), frames, spec)


@contextmanager
def as_data(spec: str, frames: int | None = None, quiet: bool = False) -> Iterator[str]:
    """`KIND:DIR` for the data that a command was given; `demo` stands for the demo's drive.

    `sim:SEED` is rendered once, with all of its truth, to a folder that exists until the end of the block.
    """
    from edgemap.runtime.inputs.open import DEMO

    if not spec.startswith(PREFIX):
        yield f"drive:{DEMO}" if spec == "demo" else spec
        return
    import tempfile
    from pathlib import Path

    from tqdm import tqdm

    camera = simulated(spec, frames)
    from edgemap.simulation.record import record

    with tempfile.TemporaryDirectory(prefix="edgemap-sim-") as name:
        folder = Path(name) / "drive"
        with tqdm(total=camera.world.frames, unit=" pictures", desc=spec, disable=quiet or None) as bar:

            def progress(done: int, _total: int) -> None:
                bar.update(done - bar.n)

            record(camera.world, folder, progress=progress)
        yield f"drive:{folder}"
