"""An hour of driving through a rendered home, 10 pictures a second: does a step get slower, is the map true?

Half of the hour is new; then the robot drives the same way back and forth, which counts for cost only. Pictures are
rendered and searched once: `out` keeps both, and a rendering that was stopped goes on.
"""

import pickle
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from edgemap.benchmarks.map_variants import replayed, true_objects
from edgemap.evaluation.objects import score_map
from edgemap.geometry.map_object import MapObject
from edgemap.runtime.inputs.drives import Drive, open_drive
from edgemap.runtime.motion.odometry.protocol import Motion
from edgemap.runtime.network.bundle import load_bundle
from edgemap.runtime.network.store import bundle_folder
from edgemap.runtime.step.frame_observations import FrameObservations
from edgemap.runtime.step.mapper import Mapper
from edgemap.runtime.step.slam import SlamOptions
from reliability.day import GROWTH_MB, drive_through
from reliability.lies import edgemap
from reliability.parts import PartReport

HOME = 8150  # of seed 0
RATE_HZ, NEW_FRAMES, FRAMES = 10, 18_000, 36_000
MINUTES, EARLY, LATE = 60, 10, 60  # a map is complete after ten minutes
P50_GROWTH, P99_GROWTH, P50_MS, P99_MS = 1.1, 1.5, 2.0, 8.0
LIMIT_S = 1800.0  # of processor time for the back end


def run(seed: int, share: float, out: Path) -> PartReport:
    """The real front end once (hybrid odometry with wheels), the real back end for the whole hour."""
    frames = max(MINUTES, round(NEW_FRAMES * share))
    folder = out / f"{HOME + seed}-{frames}"
    drive = _rendered(folder, HOME + seed, frames)
    source = RecordedDrive(_observed(drive, frames, out / f"{folder.name}.pkl"), drive)
    steps = FRAMES * frames // NEW_FRAMES // MINUTES * MINUTES
    mapper = Mapper(closes_loops=True)
    rows = drive_through(mapper, source.step, source.f1, steps, MINUTES, 1.0, LIMIT_S, RATE_HZ)
    return _report(rows, len(source.observed), steps)


class RecordedDrive:
    """What the front end made of a drive, then back along the same way, and forth again, stamps going on."""

    def __init__(self, observed: list[FrameObservations], drive: Drive) -> None:
        self.observed, self._drive, self._steps = observed, drive, 0

    def f1(self, objects: list[MapObject]) -> float:
        """Of a map, one to one by class within 0.5 m."""
        truth = true_objects(self._drive, min(self._steps, len(self.observed)))
        return float(score_map(objects, truth)["f1"] or 0.0)

    def step(self) -> FrameObservations:
        """The next frame; on the way back a frame's motion is the later one's, inverted."""
        step, ends = self._steps, len(self.observed) - 1
        self._steps += 1
        lap, along = divmod(max(step - 1, 0), ends)
        at = along + (step > 0) if lap % 2 == 0 else ends - 1 - along
        seen, motion = self.observed[at], self.observed[at].motion
        if lap % 2:
            motion = inverted(self.observed[at + 1].motion)
        stamp_s = step / RATE_HZ
        sightings = [replace(sighting, frame=step, stamp_s=stamp_s) for sighting in seen.sightings]
        return replace(seen, index=step, stamp_s=stamp_s, sightings=sightings, motion=motion)


def inverted(motion: Motion) -> Motion:
    """The same motion driven back, as well known."""
    back = motion.motion.inverse()
    c, s = np.cos(motion.motion.yaw_rad), np.sin(motion.motion.yaw_rad)
    wrt_motion: NDArray[np.float64] = np.array([[-c, -s, back.y_m], [s, -c, -back.x_m], [0.0, 0.0, -1.0]])
    return Motion(back, wrt_motion @ motion.covariance @ wrt_motion.T, motion.faults, motion.state)


def _rendered(folder: Path, seed: int, frames: int) -> Drive:
    done = edgemap("simulate", "--seed", seed, "--frames", frames, "--rate", RATE_HZ, "-o", folder)
    if done.returncode:
        sys.exit(f"edgemap simulate --seed {seed}: {done.stderr.strip()}")
    return open_drive(f"drive:{folder}")


def _observed(drive: Drive, frames: int, path: Path) -> list[FrameObservations]:
    """What the front end makes of the drive's pictures; recorded beside them."""
    if not path.is_file():
        bundle = load_bundle(bundle_folder("edgemap-nano"))
        observed: list[FrameObservations] = []
        replayed(drive, bundle, {"own": SlamOptions()}, frames, seen=lambda _, result: observed.append(result.observed))
        unfinished = path.with_suffix(".part")
        unfinished.write_bytes(pickle.dumps(observed))
        unfinished.replace(path)
    return pickle.loads(path.read_bytes())


def _report(rows: list[dict[str, Any]], new: int, steps: int) -> PartReport:
    early, late = rows[EARLY - 1], rows[-1]
    failures = []
    for name, growth, bound in (("p50_ms", P50_GROWTH, P50_MS), ("p99_ms", P99_GROWTH, P99_MS)):
        if late[name] > min(growth * early[name], bound):
            failures.append(f"{name}: {early[name]:.2f} in minute {EARLY}, {late[name]:.2f} in minute {LATE}")
    if late["rss_mb"] - early["rss_mb"] > GROWTH_MB:
        failures.append(f"memory: {early['rss_mb']:.0f} MB in minute {EARLY}, {late['rss_mb']:.0f} MB in minute {LATE}")
    if len(rows) < MINUTES:
        failures.append(f"the hour took too long: {len(rows)} of {MINUTES} minutes in {LIMIT_S} s of processor time")
    return PartReport(tuple(failures), {"minutes": rows, "steps": steps, "new": new})
