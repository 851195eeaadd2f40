"""This build beside another commit, in turn in one run: `python -m edgemap.benchmarks.beside COMMIT`.

Each build is a process of its own that imports its own tree and keeps its bundle and its map; blocks of steps alternate
between the two, so that what else the machine does meets both. Only the step is timed; its processor time includes
threads that wait in circles. The other build needs the packages of this environment and its commit in this repository;
it must have the modules that `WORKER` imports.
"""

import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

ROOMS = ("geometry", "runtime", "evaluation", "simulation", "export", "benchmarks", "plots", "view", "cli", "models")
FRAMES = 30  # in a block
LEGS = {"10": 10.0, "30": 30.0, "unpaced": 0.0}

# Runs in either build.
WORKER = """
import os, sys, time
from pathlib import Path
os.environ.setdefault("OPENBLAS_NUM_THREADS", sys.argv[1])
bundle_name, engine = sys.argv[2], sys.argv[3]
# An editable install would answer for modules that this tree does not have.
sys.meta_path[:] = [finder for finder in sys.meta_path if "__editable__" not in getattr(finder, "__module__", "")]
import edgemap.runtime
from edgemap.geometry.camera.floor import FloorCamera
from edgemap.runtime.inputs.open import open_camera
from edgemap.runtime.motion.odometry import open_odometry
from edgemap.runtime.network.bundle import load_bundle
from edgemap.runtime.network.store import bundle_folder
from edgemap.runtime.step.config import Config
from edgemap.runtime.step.mapper import new_mapper
from edgemap.runtime.step.pipeline import Pipeline
from edgemap.runtime.step.slam import SemanticSlam
root, path = Path(os.environ["PYTHONPATH"]), Path(edgemap.runtime.__file__)
assert path.is_relative_to(root), f"edgemap.runtime is {path}, not of {root}"
def build(paced):
    bundle = load_bundle(bundle_folder(bundle_name), pace="camera" if paced else "files", engine=engine)
    def new(camera):
        floor = FloorCamera(camera.info.intrinsics, camera.info.mount)
        pipeline = Pipeline(bundle, floor, open_odometry("hybrid", bundle, camera, floor))
        return SemanticSlam(pipeline, new_mapper(Config()))
    return new
camera = slam = None
new, was = None, None
for line in sys.stdin:
    rate, count = line.split()
    rate, count = float(rate), int(count)
    if was != (rate > 0):
        new, was, slam = build(rate > 0), rate > 0, None
    if slam is None:
        camera = open_camera("demo")
        slam = new(camera)
    frames = []
    while len(frames) < count:
        frame = camera.read()
        if frame is None:
            camera = open_camera("demo")
            slam = new(camera)
            continue
        frames.append((slam, frame))
    times, cpu, start = [], time.process_time(), time.perf_counter()
    for index, (one, frame) in enumerate(frames):
        if rate:
            time.sleep(max(0.0, start + index / rate - time.perf_counter()))
        before = time.perf_counter()
        one.step(frame)
        one.objects()
        times.append(1e3 * (time.perf_counter() - before))
    if rate:
        time.sleep(max(0.0, start + count / rate - time.perf_counter()))
    spent, wall = time.process_time() - cpu, time.perf_counter() - start
    time.sleep(0.05)
    print(times, spent, wall, flush=True)
"""


def beside(there: Path, bundle: str, engine: str, blocks: int) -> dict[str, Any]:
    """Ratios this / other of the step's median and processor time a frame, for each leg; and both builds' figures."""
    workers = {
        "other": start_worker(there, "2", bundle, "onnxruntime"),
        "this": start_worker(Path(__file__).resolve().parents[1], "1", bundle, engine),
    }
    document: dict[str, Any] = {"bundle": bundle, "engine": engine, "frames": blocks * FRAMES}
    for leg, rate in LEGS.items():
        rows: dict[str, list[tuple[list[float], float, float]]] = {name: [] for name in workers}
        for block in range(blocks + 1):
            order = list(workers) if block % 2 else list(workers)[::-1]
            for name in order:
                row = timed_block(workers[name], rate)
                if block:  # the first one warms up
                    rows[name].append(row)
        figures = {name: block_figures(found) for name, found in rows.items()}
        ratios = {
            f"{key}_ratio": round(figures["this"][key] / figures["other"][key], 3)
            for key in ("p50_ms", "cpu_ms_per_frame", "fps")
        }
        document[leg] = figures | ratios
    for worker in workers.values():
        worker.stdin.close()  # type: ignore[union-attr]
        worker.wait()
    return document


def block_figures(rows: list[tuple[list[float], float, float]]) -> dict[str, float]:
    """Figures of blocks, each (step times in ms, processor seconds, wall seconds), over all their frames."""
    times = np.concatenate([row[0] for row in rows])
    cpu_s, wall_s = sum(row[1] for row in rows), sum(row[2] for row in rows)
    return {
        "p50_ms": round(float(np.median(times)), 2),
        "p99_ms": round(float(np.percentile(times, 99)), 2),
        "cpu_ms_per_frame": round(1e3 * cpu_s / len(times), 2),
        "cpu_percent": round(100.0 * cpu_s / wall_s, 1),
        "fps": round(1e3 / float(times.mean()), 1),
    }


def start_worker(root: Path, blas: str, bundle: str, engine: str) -> subprocess.Popen[str]:
    """A process that runs the build of this tree, and nothing of an installed edgemap. blas: threads of BLAS."""
    package = Path(tempfile.mkdtemp()) / "edgemap"
    package.mkdir()
    for room in ROOMS:
        (package / room).symlink_to(root.resolve() / room)
    (package / "__init__.py").write_text((root.resolve() / "api" / "__init__.py").read_text())
    command = [sys.executable, "-c", WORKER, blas, bundle, engine]
    environment = {"PYTHONPATH": str(package.parent), "PATH": "/usr/bin:/bin", "HOME": str(Path.home())}
    return subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=environment)


def timed_block(worker: subprocess.Popen[str], rate: float) -> tuple[list[float], float, float]:
    """Step times in ms, processor seconds and wall seconds of one block. rate: frames a second; 0 for no pauses."""
    assert worker.stdin is not None
    assert worker.stdout is not None
    worker.stdin.write(f"{rate} {FRAMES}\n")
    worker.stdin.flush()
    line = worker.stdout.readline()
    if not line:
        sys.exit("one of the builds ended; its error stands above")
    times, spent, wall = line.strip().lstrip("[").replace("]", "").rsplit(" ", 2)
    return [float(value) for value in times.split(", ")], float(spent), float(wall)


def main() -> None:
    """Check the commit out into a temporary worktree, measure, print one JSON document."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("commit")
    parser.add_argument("--bundle", default="edgemap-nano")
    parser.add_argument("--engine", default="onnxruntime")
    parser.add_argument("--blocks", type=int, default=10, help=f"of {FRAMES} frames, for each build and rate")
    given = parser.parse_args()
    repository = Path(__file__).resolve().parents[1]
    with tempfile.TemporaryDirectory() as folder:
        there = Path(folder) / "other"
        subprocess.run(["git", "-C", repository, "worktree", "add", "-q", "--detach", there, given.commit], check=True)
        try:
            print(json.dumps(beside(there, given.bundle, given.engine, given.blocks), indent=1))
        finally:
            subprocess.run(["git", "-C", repository, "worktree", "remove", "--force", there], check=True)


if __name__ == "__main__":
    main()
