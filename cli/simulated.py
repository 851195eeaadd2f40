"""`sim:SEED` as data: rendered to a folder."""

from collections.abc import Iterator
from contextlib import contextmanager

PREFIX = "sim:"


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

    from edgemap.runtime.frames.camera import CameraOptions
    from edgemap.simulation.live import open as open_sim
    from edgemap.simulation.record import record

    camera = open_sim(spec.removeprefix(PREFIX), CameraOptions(frames=frames))

    with tempfile.TemporaryDirectory(prefix="edgemap-sim-") as name:
        folder = Path(name) / "drive"
        with tqdm(total=camera.world.frames, unit=" pictures", desc=spec, disable=quiet or None) as bar:

            def progress(done: int, _total: int) -> None:
                bar.update(done - bar.n)

            record(camera.world, folder, progress=progress)
        yield f"drive:{folder}"
