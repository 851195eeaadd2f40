"""Time of Darknet networks in each number format: `python -m edgemap.benchmarks.networks [NAME...]`.

Each is exported with random weights, which speed does not depend on, and its variants run in turn on one machine. An
int8 variant is calibrated on pictures of the demo. Bundles are kept in runs/networks/.
"""

from functools import partial
from itertools import islice, repeat
from pathlib import Path

import cv2
import tyro

from edgemap.benchmarks.bench import in_turn
from edgemap.runtime.frames.inference import Engine, Precision
from edgemap.runtime.frames.reading import print_message
from edgemap.runtime.network.bundle import load_bundle
from edgemap.runtime.network.engines import processor_name

FOLDER = Path("runs/networks")
PICTURES = 4
VARIANTS: tuple[tuple[Engine, Precision], ...] = (
    ("onnxruntime", "float32"), ("openvino", "float32"), ("onnxruntime", "int8"), ("openvino", "int8"),
)  # fmt: skip


def random_bundle(name: str) -> Path:
    """The bundle of a network with random weights and an int8 variant; exported where it is not there yet."""
    from edgemap.export.exporter import export_backbone
    from edgemap.runtime.inputs.open import open_camera

    pictures, bundle = FOLDER / "pictures", FOLDER / name
    if bundle.exists():
        return bundle
    pictures.mkdir(parents=True, exist_ok=True)
    with open_camera("demo") as camera:
        for number, frame in enumerate(islice(iter(camera.read, None), 0, 60 * PICTURES, 60)):
            cv2.imwrite(str(pictures / f"{number}.png"), frame.image)
    export_backbone(name, bundle, random_seed=0, calibrate=pictures)
    return bundle


def measure(bundle: Path, threads: int, rounds: int) -> list[tuple[str, float, float]]:
    """Variant, median wall time and median processor time of all threads of one picture, ms."""
    networks = {
        f"{precision}, {engine}": load_bundle(bundle, threads, precision, engine=engine).backbone
        for engine, precision in VARIANTS
    }
    calls = {name: partial(network.run, network.zeros()) for name, network in networks.items()}
    found = in_turn(repeat(calls, rounds + 2))
    return [(name, *found[name]) for name in calls]


def main(
    names: tyro.conf.Positional[tuple[str, ...]] = ("yolov3", "yolov3-tiny"), threads: int = 2, rounds: int = 15
) -> None:
    """names: of networks that `edgemap export --backbone` has. threads: of each network."""
    print_message(f"{processor_name()}, {threads} threads, median of {rounds} in turn")
    for name in names:
        for variant, wall_ms, cpu_ms in measure(random_bundle(name), threads, rounds):
            print(
                f"{name}, {variant}: {wall_ms:.1f} ms, {1e3 / wall_ms:.1f}/s, processor time {cpu_ms:.1f} ms",
                flush=True,
            )


if __name__ == "__main__":
    tyro.cli(main, description=__doc__)
