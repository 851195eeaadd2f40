"""Runs of the demo into a run folder, killed with -9 at a random moment: what is on disk then."""

import os
import signal
import struct
import time
import warnings
from pathlib import Path

import cv2
import numpy as np

from edgemap.geometry.errors import EdgemapError
from edgemap.geometry.map_object import MapObject
from edgemap.runtime.inputs.open import open_camera
from edgemap.runtime.outputs.sinks.run_folder import RunFolder
from edgemap.runtime.step.loop import steps
from edgemap.runtime.step.map_file import load_map
from edgemap.runtime.step.sinks import Sink
from edgemap.runtime.step.slam import StepResult
from reliability.demo_slam import DemoDrive
from reliability.parts import PartReport

KILLS, FRAMES = 200, 200
MAX_LOST_S = 1.0
FILES = {"map.json", "trajectory.tum", "sightings.jsonl", "run.json", "mount.jpg", "grid.npz", "grid.before.npz"}


class _Teller(Sink):
    """A sink that tells the stamp of every step, before the run folder hears of it."""

    name = "teller"

    def __init__(self, pipe: int) -> None:
        self._pipe = pipe

    def write(self, result: StepResult, objects: list[MapObject]) -> None:
        """Tell the stamp."""
        os.write(self._pipe, struct.pack("<d", result.frame.stamp_s))


def run(seed: int, share: float, out: Path) -> PartReport:
    """Each run is a process of its own, forked after everything is loaded; the wheels alone drive it."""
    demo, random = DemoDrive(FRAMES), np.random.default_rng(seed)
    for _ in range(2):  # the first run fills the backbone's cache
        started = time.monotonic()
        _child(demo, out / f"whole-{time.time_ns()}", -1)
        whole_s = time.monotonic() - started
    lost_s, failures, litter, before = [], [], 0, 0
    kills = max(1, round(KILLS * share))
    for number in range(kills):
        folder = out / f"{time.time_ns()}-{number}"
        told_s = _kill(demo, folder, random.uniform(0.0, 1.0) * whole_s)
        left = {path.name for path in folder.iterdir()} - FILES if folder.exists() else set[str]()
        litter += len(left) - any(name.startswith(".") for name in left)  # the write that it was killed in
        if told_s is None:
            before += 1
            continue
        try:
            load_map(folder)
            lines = (folder / "trajectory.tum").read_text().splitlines()
            kept_s = float(lines[-1].split()[0]) if lines else demo.stamps_s[0]
            if lines and len(lines[-1].split()) != 8:
                failures.append(f"kill {number}: trajectory.tum ends with {lines[-1]!r}")
            lost_s.append(told_s - kept_s)
        except (EdgemapError, OSError, ValueError) as error:
            failures.append(f"kill {number}: {error}")
    worst_s = max(lost_s, default=0.0)
    if worst_s > MAX_LOST_S:
        failures.append(f"{worst_s:.2f} s of stream lost (limit {MAX_LOST_S} s)")
    if litter:
        failures.append(f"{litter} files left behind")
    return PartReport(tuple(failures), {"kills": kills, "lost_s": lost_s, "before": before, "litter": litter})


def _kill(demo: DemoDrive, folder: Path, after_s: float) -> float | None:
    """The newest stamp that the run told before it was killed; None for none."""
    reading, writing = os.pipe()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # of a fork beside threads: the child starts none of theirs
        pid = os.fork()
    if pid == 0:
        try:
            os.close(reading)
            _child(demo, folder, writing)
            time.sleep(60.0)  # a run that was faster than its death
        finally:
            os._exit(1)
    os.close(writing)
    time.sleep(after_s)
    os.kill(pid, signal.SIGKILL)
    os.waitpid(pid, 0)
    told = b""
    while chunk := os.read(reading, 1 << 16):
        told += chunk
    os.close(reading)
    return struct.unpack("<d", told[-8:])[0] if told else None


def _child(demo: DemoDrive, folder: Path, pipe: int) -> None:
    cv2.setNumThreads(1)
    sinks = [RunFolder(folder, demo.floor, {})]
    with open_camera("demo") as camera:
        for _ in steps(camera, demo.slam("wheel"), [_Teller(pipe), *sinks] if pipe >= 0 else sinks, FRAMES):
            pass
