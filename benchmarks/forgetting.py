"""How maps forget: `python -m edgemap.benchmarks.forgetting --seeds A:B --bundle DIR [--drives FOLDER]`.

Per seed a drive makes a map; pieces are removed and others put elsewhere; a second drive, with the start pose known,
goes on with the map. Poses are true in both, so that nothing but the forgetting is measured. Rendered drives stay in
the folder and are used again.
"""

from __future__ import annotations

import argparse
import json
import math
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from edgemap.geometry.map_object import MapObject
from edgemap.geometry.objects.forgetting import Forgetter
from edgemap.geometry.se2 import SE2
from edgemap.runtime.network.bundle import Bundle

NEAR_M = 0.5  # a mapped object within this of a true one of its label is that one
LOOKS = 10  # clear looks after which what is gone must have left the map


def score(
    saved: Sequence[MapObject],
    was: Sequence[tuple[str, float, float, bool]],
    left: dict[str, int],
    looks: dict[str, int],
    now: Sequence[MapObject],
) -> Counter[str]:
    """Counts of one seed. saved, now: the map before and after the second drive. was: label, place and whether it is
    still there, for all that stood there. left: id to clear looks until it left. looks: clear looks by id.

    `absent`: of those mapped, that left or had at least ten clear looks; `forgotten`: within ten. `present`, `lost`:
    still there, and off the map with nothing of the label in their place. `false`, `false_gone`: mapped where nothing
    of their label stood. `unlooked`: absent, with too few looks to tell.
    """
    counts: Counter[str] = Counter()
    for item in saved:
        near = [
            (math.dist((x, y), item.position_m), there)
            for label, x, y, there in was
            if label == item.label and math.dist((x, y), item.position_m) <= NEAR_M
        ]
        if not near:
            counts.update({"false": 1, "false_gone": int(item.id in left)})
        elif min(near)[1]:
            counts["present"] += 1
            again = any(
                other.label == item.label and np.linalg.norm(other.position_m - item.position_m) <= NEAR_M
                for other in now
            )
            counts["lost"] += item.id in left and not again
        elif item.id in left or looks.get(item.id, 0) >= LOOKS:
            counts["absent"] += 1
            counts["forgotten"] += left.get(item.id, LOOKS + 1) <= LOOKS
        else:
            counts["unlooked"] += 1
    return counts


def measure(before: Path, after: Path, bundle: Bundle) -> tuple[Counter[str], dict[str, int]]:
    """Counts of one seed's two drive folders, and the clear looks after which objects left."""
    from edgemap.runtime.inputs.drives import open_drive

    moved = json.loads((after / "moved.json").read_text())
    x_m, y_m, yaw_deg = moved["start"]
    saved, _, _ = _map_of(before, bundle, (), SE2())
    now, left, looks = _map_of(after, bundle, saved, SE2(x_m, y_m, math.radians(yaw_deg)))
    changed = {item["id"] for kind in ("removed", "moved") for item in moved[kind]}
    stood = [item for item in open_drive(f"drive:{before}").objects if item["on_floor"]]
    was = [(item["label"], item["x_m"], item["y_m"], item["id"] not in changed) for item in stood]
    counts = score(saved, was, left, looks, now)
    for item in moved["moved"]:
        seen = _seen_frames(after, item["id"])
        if seen >= LOOKS:
            counts["newly_placed"] += 1
            counts["newly_mapped"] += any(
                other.label == item["label"] and math.dist(other.position_m, item["is_m"]) <= NEAR_M for other in now
            )
    return counts, left


def _seen_frames(folder: Path, identity: int) -> int:
    objects = json.loads((folder / "objects.json").read_text())["objects"]
    return next(item["visible_frames"] for item in objects if item["id"] == identity)


def _map_of(
    folder: Path, bundle: Bundle, saved: Sequence[MapObject], start: SE2
) -> tuple[list[MapObject], dict[str, int], dict[str, int]]:
    """The map after a drive with true poses; clear looks until each object left, and of each object."""
    from edgemap.geometry.camera.floor import FloorCamera
    from edgemap.runtime.inputs.cameras.pictures import drive_camera
    from edgemap.runtime.inputs.drives import open_drive
    from edgemap.runtime.motion.odometry import open_odometry
    from edgemap.runtime.step.mapper import Mapper
    from edgemap.runtime.step.pipeline import Pipeline
    from edgemap.runtime.step.slam import SemanticSlam

    drive = open_drive(f"drive:{folder}")
    assert drive.mount is not None
    with drive_camera(drive, str(folder)) as source:
        assert source.intrinsics is not None
        floor = FloorCamera(source.intrinsics, drive.mount)
        forgetter = Forgetter(floor)
        motion = open_odometry("truth", bundle, source, floor)
        mapper = Mapper(forgetter=forgetter)
        mapper.start_in(saved, start, sigmas=(0.0, 0.0, 0.0))
        slam = SemanticSlam(Pipeline(bundle, floor, motion), mapper)
        left: dict[str, int] = {}
        while (frame := source.read()) is not None:
            known = {item.id for item in slam.objects()}
            merged = slam.step(frame).merged
            for identity in known - {item.id for item in slam.objects()} - set(merged):
                left[identity] = forgetter.observations[identity]
    return slam.objects(), left, dict(forgetter.observations)


def _render(seed: int, moved: int, frames: int, folder: Path) -> None:
    from edgemap.simulation.record import record
    from edgemap.simulation.world import Choices, draw_world

    typed = f"edgemap simulate --seed {seed} --frames {frames}" + (f" --moved {moved}" if moved else "")
    record(draw_world(seed, frames, Choices(moved=moved)), folder, command=typed)


def main() -> None:
    """Command line of the measurement."""
    from edgemap.runtime.network.bundle import load_bundle

    parser = argparse.ArgumentParser(prog="python -m edgemap.benchmarks.forgetting", description="How maps forget.")
    parser.add_argument("--seeds", required=True, metavar="A:B", help="from A up to, not including, B")
    parser.add_argument("--bundle", required=True, type=Path, metavar="DIR")
    parser.add_argument("--drives", type=Path, default=Path("drives"), metavar="FOLDER", help="where drives are kept")
    parser.add_argument("--moved", type=int, default=4, metavar="K", help="so many removed, so many put elsewhere")
    parser.add_argument("--frames", type=int, default=450, metavar="N")
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    first, _, end = options.seeds.partition(":")
    bundle, total, rows = load_bundle(options.bundle), Counter(), {}
    for seed in range(int(first), int(end)):
        before, after = options.drives / f"{seed}-before", options.drives / f"{seed}-after"
        _render(seed, 0, options.frames, before)
        _render(seed, options.moved, options.frames, after)
        counts, left = measure(before, after, bundle)
        total += counts
        rows[seed] = dict(counts)
        if not options.json:
            print(f"{seed}: {_line(counts)}; left after looks: {sorted(left.values())}", flush=True)
    document: dict[str, Any] = {"bundle": bundle.manifest.name, "seeds": rows, "total": dict(total)}
    print(json.dumps(document, indent=1) if options.json else f"all:  {_line(total)}")


def _line(counts: Counter[str]) -> str:
    return (
        f"absent {counts['absent']}, forgotten within {LOOKS} looks {counts['forgotten']}, too few looks "
        f"{counts['unlooked']}; present {counts['present']}, lost {counts['lost']}; mapped in error {counts['false']}, "
        f"of these gone {counts['false_gone']}; newly placed {counts['newly_placed']}, mapped {counts['newly_mapped']}"
    )


if __name__ == "__main__":
    main()
