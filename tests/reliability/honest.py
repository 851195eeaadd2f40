"""Honest poses, wheels, depth and IMU on rendered homes and real walks: none is accused."""

import json
import os
import shutil
from pathlib import Path

import numpy as np

from edgemap.runtime.inputs.drives import open_drive
from reliability.lies import KINDS, Faults, accused, judged, mapped, rendered
from reliability.parts import PartReport

SEEDS = range(9400, 9430)
# Walks of $EDGEMAP_SHARED/data: with their own depth and IMU, and with their true poses as a file.
WALKS = ("c2w:lounge", "c2w:hololens", "c2w:go2_office", "kitti:kitti00")
SENSED = ("c2w:realsense_lab", "c2w:redkitchen", "euroc:euroc")  # whose poses are not upright, or of another frame


def run(seed: int, share: float, out: Path) -> PartReport:
    """A share of the homes, and all walks that are there. A part that was ended goes on. seed: not used."""
    table, failures = list[str](), list[str]()
    for number in SEEDS[: round(len(SEEDS) * share)]:
        home = rendered(out / "homes", number)
        for sensor in KINDS:
            f1, level, faults = judged(home, out, None, sensor, 1.0)
            _add(f"{number} {sensor}: F1 {f1:.2f}", level, faults, table, failures)
    data = Path(os.environ.get("EDGEMAP_SHARED", "../shared")) / "data"
    for walk in (*WALKS, *SENSED):
        kind, _, name = walk.partition(":")
        if not (data / name).is_dir():
            continue
        for poses in (False, True)[: 1 + (walk in WALKS)]:
            level, faults = _walked(f"{kind}:{data / name}", out, poses)
            _add(f"{walk}{' with its true poses' * poses}", level, faults, table, failures)
    shutil.rmtree(out / "results", ignore_errors=True)
    return PartReport(tuple(failures), {"runs": len(table), "accused": len(failures)}, tuple(table))


def _add(case: str, level: str, faults: Faults, table: list[str], failures: list[str]) -> None:
    named = accused(faults) or [fault for fault in faults if level == "refused"]
    table.append(f"{case}, {level}, {named[0] if named else 'nobody accused'}")
    failures += [table[-1]] if named else []
    print(table[-1], flush=True)


def _walked(spec: str, out: Path, poses: bool) -> tuple[str, Faults]:
    """Verdict and faults of a walk. poses: with its truth as a file that carries the map."""
    kept, words = out / "results" / f"{Path(spec).name}-{poses}.json", list[object]()
    if kept.is_file():
        return tuple(json.loads(kept.read_text()))
    if poses and (truth := open_drive(spec).truth) is not None:
        yaw = np.array([pose.yaw_rad for pose in truth.poses])
        flat = [(pose.x_m, pose.y_m, 0.0, 0.0, 0.0) for pose in truth.poses]
        np.savetxt(out / "true.tum", np.column_stack([truth.stamps_s, flat, np.sin(yaw / 2.0), np.cos(yaw / 2.0)]))
        words += ["--odometry", out / "true.tum", "--pose-frame", "base"]
    found = mapped(spec, out / "run", *words)
    kept.parent.mkdir(parents=True, exist_ok=True)
    kept.write_text(json.dumps(found))
    return found
