"""Cost of a map update by the size of the map: `python -m edgemap.benchmarks.map_size [--plot DIR]`.

Objects stand 3 m apart on a square, a few at a time in view of a robot that passes; the map is the default one, the
sightings made (no pictures). Times are processor time of `FloorMap.update` and `objects`, medians, one thread.
"""

from __future__ import annotations

import argparse
import json
import time
from pathlib import Path
from typing import Any

import numpy as np

from edgemap.geometry.objects.floor_map import FloorMap
from edgemap.geometry.observations.sighting import PlacedSighting, Sighting
from edgemap.geometry.se2 import SE2
from edgemap.runtime.network.compute import one_blas_thread

OBJECTS, TIMES_SEEN = (100, 1_000, 3_000, 10_000), (6, 25, 100)  # up to a million observations
IN_VIEW, APART_M, SIGMA_M = 5, 3.0, 0.05
LABELS = ("chair", "couch", "potted plant", "bed", "refrigerator")
TIMED = 200  # frames


def sightings(numbers: list[int], side: int, frame: int, random: np.random.Generator) -> list[PlacedSighting]:
    """One frame's sightings of some of the objects."""
    found = []
    for row, number in enumerate(numbers):
        place = APART_M * np.array([number % side, number // side]) + random.normal(0.0, SIGMA_M, 2)
        base, noise = np.array([2.0, 0.0]), np.eye(2) * SIGMA_M**2
        label = LABELS[number % len(LABELS)]
        own = Sighting(label, 0.8, base, noise, noise / 4, 0.5, 0.9, 0.6, 2.0, row, frame, frame / 10)
        found.append(own.placed(SE2(*(place - base)), np.eye(3) * 1e-6))
    return found


def elsewhere(floor_map: FloorMap, frame: int) -> None:
    """Moves the robot on, so that the current objects leave the view."""
    if floor_map.graph.trajectory.poses:
        floor_map.graph.advance(SE2(2.0 * floor_map.graph.rule.landmarks.gap_m), np.eye(3) * 1e-6, frame / 10)


def measure(objects: int, times_seen: int) -> dict[str, Any]:
    """Median and 99th percentile of one frame's update, ms of processor time, on a map of so many objects that were
    seen so many times each."""
    random, side, floor_map, frame = np.random.default_rng(0), int(np.ceil(objects**0.5)), FloorMap(), 0
    for first in range(0, objects, IN_VIEW):
        elsewhere(floor_map, frame)
        for _ in range(times_seen):
            floor_map.update(sightings(list(range(first, min(first + IN_VIEW, objects))), side, frame, random))
            frame += 1
    floor_map.objects()
    times_ms = []
    for _ in range(TIMED):
        first = int(random.integers(0, objects - IN_VIEW))
        shown = sightings(list(range(first, first + IN_VIEW)), side, frame, random)
        frame += 1
        elsewhere(floor_map, frame)
        before = time.process_time()
        floor_map.update(shown)
        floor_map.objects()
        times_ms.append(1e3 * (time.process_time() - before))
    row: dict[str, Any] = {"objects": len(floor_map.objects()), "observations": objects * times_seen}
    return row | {
        "p50_ms": round(float(np.median(times_ms)), 3),
        "p99_ms": round(float(np.quantile(times_ms, 0.99)), 3),
    }


def main() -> None:
    """Print one JSON document; draw it where a folder is given."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--plot", type=Path)
    parser.add_argument("--seen", type=int, nargs="+", default=list(TIMES_SEEN), help="times each object was seen")
    given = parser.parse_args()
    one_blas_thread()
    rows = [measure(objects, seen) for seen in given.seen for objects in OBJECTS]
    print(json.dumps(rows, indent=1))
    if given.plot:
        from edgemap.plots.bench import plot_map_size

        print(plot_map_size(given.plot / "map_size.png", rows))


if __name__ == "__main__":
    main()
