"""Map quality and processor time at each step of the budget: `python -m edgemap.benchmarks.effort demo drive:DIR`.

Every step of the budget's ladder is kept to for a whole drive, unpaced, so the figures do not depend on the machine's
load but for processor time, which is that of the step alone.
"""

from __future__ import annotations

import argparse
import json
import math
import time
from dataclasses import asdict
from typing import Any

import numpy as np

from edgemap.benchmarks.map_variants import true_objects
from edgemap.evaluation.objects import score_map
from edgemap.geometry.camera.floor import FloorCamera
from edgemap.runtime.inputs.budget import LADDER, Effort
from edgemap.runtime.inputs.cameras.around import BudgetedCamera
from edgemap.runtime.inputs.drives import open_drive
from edgemap.runtime.inputs.open import DEMO, open_camera
from edgemap.runtime.network.bundle import Bundle, load_bundle
from edgemap.runtime.network.compute import one_blas_thread
from edgemap.runtime.network.store import bundle_folder, default_bundle
from edgemap.runtime.step.build import SlamOptions, build_slam


def drive_with(spec: str, bundle: Bundle, effort: Effort, wheels: bool) -> dict[str, Any]:
    """One drive at one effort: processor time per frame of the camera, the map's figures, the last pose's error."""
    source = open_camera(spec)
    assert source.intrinsics
    assert source.mount
    assert source.truth
    floor = FloorCamera(source.intrinsics, source.mount)
    slam = build_slam(source, bundle, floor, SlamOptions(wheels=wheels))
    spent_s, poses, stamps_s, last = 0.0, [], [], 0
    with BudgetedCamera(source, replayed=[effort]) as camera:
        while (frame := camera.read()) is not None:
            before = time.process_time()
            poses.append(slam.step(frame).pose_map_base)
            spent_s += time.process_time() - before
            stamps_s.append(frame.stamp_s)
            last += effort.take_every
    start = source.truth.at(stamps_s[0]).inverse()
    errors = [(start @ source.truth.at(s)).inverse() @ pose for s, pose in zip(stamps_s, poses, strict=True)]
    off_m = [math.hypot(error.x_m, error.y_m) for error in errors]
    figures = score_map(slam.objects(), true_objects(open_drive(spec), last))
    return {
        **{name: value for name, value in asdict(effort).items() if name != "since"},
        "wheels": wheels,
        "cpu_ms_per_camera_frame": round(1e3 * spent_s / last, 2),
        **{name: figures[name] for name in ("f1", "precision", "recall", "median_error_m", "anees")},
        "pose_error_m": round(float(np.sqrt(np.mean(np.square(off_m)))), 3),
    }


def main() -> None:
    """Print one JSON document, a row for each drive, effort and with or without wheels."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("drives", nargs="+", metavar="SPEC")
    given = parser.parse_args()
    one_blas_thread()
    document: dict[str, list[dict[str, Any]]] = {}
    for spec in (f"drive:{DEMO}" if drive == "demo" else drive for drive in given.drives):
        bundle = load_bundle(bundle_folder(default_bundle(spec)[0]), 1)
        has_wheels = open_camera(spec).wheel is not None
        document[spec] = [
            drive_with(spec, bundle, effort, wheels)
            for wheels in ([True, False] if has_wheels else [False])
            for effort in LADDER
        ]
    print(json.dumps(document, indent=1))


if __name__ == "__main__":
    main()
