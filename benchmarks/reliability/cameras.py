"""Runs of the demo with ten random camera faults each, through the real camera classes on an injected clock."""

from __future__ import annotations

import json
import traceback
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np

from edgemap.benchmarks.reliability.demo_slam import DemoDrive
from edgemap.benchmarks.reliability.faulty_camera import (
    CaptureDriver,
    FaultyDriver,
    PlannedFault,
    PlaybackDriver,
    World,
    plan,
)
from edgemap.benchmarks.reliability.parts import PartReport
from edgemap.evaluation.objects import score_map
from edgemap.geometry.errors import EdgemapError
from edgemap.geometry.objects.map_object import MapObject
from edgemap.runtime.cameras.live import LiveCamera
from edgemap.runtime.loop import run as drive
from edgemap.runtime.slam import StepResult

RUNS, FAULTS, REALSENSE_EVERY = 100, 10, 10
MAX_F1_LOSS = 0.02
SAME_M = 0.5


class _Watch:
    """A sink that notes when frames came, what faults were told, and objects that a fault cost."""

    name = "watch"

    def __init__(self, world: World) -> None:
        self._world = world
        self.frames_s: list[float] = []
        self.told: Counter[str] = Counter()
        self.lost: list[str] = []
        self.unsound = 0
        self._before: list[MapObject] = []

    def write(self, result: StepResult, objects: list[MapObject]) -> None:
        """One frame."""
        if result.faults:
            self.told.update(fault.kind.value for fault in result.faults)
            self.lost += [item.id for item in self._before if not any(_like(item, other) for other in objects)]
        self.unsound += not np.isfinite(result.pose_map_base.vector()).all()
        self.unsound += not (np.linalg.eigvalsh(result.pose_covariance) > -1e-12).all()
        self._before = objects
        self.frames_s.append(self._world.now_s)

    def fault(self, text: str) -> None:
        """Faults come with results."""

    def close(self) -> None:
        """Nothing to close."""


def _like(item: MapObject, other: MapObject) -> bool:
    """The same object, or one of its label where it stood."""
    near = float(np.linalg.norm(item.position_m - other.position_m)) < SAME_M
    return item.id == other.id or (item.label == other.label and near)


def run(seed: int, share: float, out: Path) -> PartReport:
    """Every `REALSENSE_EVERY`-th run is librealsense's playback of the demo, the others are webcams."""
    demo = DemoDrive()
    recording = _record(demo, out)
    baseline = _one(demo, None, [])
    runs = max(1, round(RUNS * share))
    rows: list[dict[str, Any]] = []
    for number in range(runs):
        random = np.random.default_rng((seed, number))
        faults = plan(random, FAULTS, demo.stamps_s[0] + 2.0, demo.stamps_s[-1] - 5.0)
        realsense = recording if number % REALSENSE_EVERY == 0 else None
        rows.append(_one(demo, realsense, faults) | {"run": number, "realsense": realsense is not None})
        with (out / "runs.jsonl").open("a") as lines:
            lines.write(json.dumps(rows[-1]) + "\n")
        print(f"cameras: run {number}: F1 {rows[-1]['f1']:.3f} {rows[-1]['failure']}", flush=True)
    recording.unlink(missing_ok=True)
    return _report(baseline, rows)


def _record(demo: DemoDrive, out: Path) -> Path:
    from edgemap.benchmarks.reliability.record_realsense import record_realsense

    path = out / "demo.db3"
    path.unlink(missing_ok=True)
    import pyrealsense2

    rs: Any = pyrealsense2
    lens = demo.floor.intrinsics
    numbers = (lens.fx, lens.fy, lens.cx, lens.cy)
    return record_realsense(path, demo.images, demo.stamps_s, stream_format=rs.format.bgr8, lens=numbers)


def _one(demo: DemoDrive, recording: Path | None, faults: list[PlannedFault]) -> dict[str, Any]:
    world = World(demo.images, demo.stamps_s, faults, demo.stamps_s[0])
    inner = CaptureDriver(world) if recording is None else PlaybackDriver(world, recording)
    slam, watch, failure = demo.slam(), _Watch(world), ""
    try:
        driver = FaultyDriver(world, inner, resets=recording is not None)
        with LiveCamera(driver, demo.floor.intrinsics, demo.floor.mount, None, world.clock_s, world.wait) as camera:
            drive(camera, slam, [watch], None, world.stop)
    except EdgemapError as error:
        failure = f"ended: {error}"
    except Exception:
        failure = f"traceback: {traceback.format_exc()}"
    begun = [fault for fault in faults if fault.begun]
    recoveries = [_recovery_s(fault, watch.frames_s) for fault in begun]
    return {
        "f1": score_map(slam.objects(), demo.truth)["f1"] or 0.0,
        "failure": failure,
        "frames": len(watch.frames_s),
        "faults": dict(Counter(fault.kind for fault in begun)),
        "told": dict(watch.told),
        "recover_s": [round(value, 3) for value in recoveries if value is not None],
        "unrecovered": [fault.kind for fault, value in zip(begun, recoveries, strict=True) if value is None],
        "lost": watch.lost,
        "unsound": watch.unsound,
    }


def _recovery_s(fault: PlannedFault, frames_s: list[float]) -> float | None:
    """From the end of the cause, or the beginning where only the supervisor ends it, to the next frame."""
    after = [stamp_s for stamp_s in frames_s if stamp_s >= fault.over_s] if fault.over else []
    return after[0] - fault.over_s if after else None


def _report(baseline: dict[str, Any], rows: list[dict[str, Any]]) -> PartReport:
    faults, told = Counter[str](), Counter[str]()
    for row in rows:
        faults.update(row["faults"])
        told.update(row["told"])
    recover = np.array([value for row in rows for value in row["recover_s"]] or [np.nan])
    p50, p99 = np.percentile(recover, [50, 99])
    f1 = float(np.mean([row["f1"] for row in rows]))
    tracebacks = [row["failure"] for row in rows if row["failure"].startswith("traceback")]
    ended = [row["failure"] for row in rows if row["failure"].startswith("ended")]
    unrecovered = [kind for row in rows for kind in row["unrecovered"]]
    lost = [identity for row in rows for identity in row["lost"]]
    unsound = sum(row["unsound"] for row in rows)
    failures = [f"{len(tracebacks)} tracebacks: {tracebacks[0]}"] if tracebacks else []
    failures += [f"{len(ended)} runs ended: {ended[0]}"] if ended else []
    failures += [f"not recovered: {Counter(unrecovered)}"] if unrecovered else []
    failures += [f"objects lost over a fault: {lost}"] if lost else []
    failures += [f"{unsound} poses or covariances that are none"] if unsound else []
    if baseline["f1"] - f1 > MAX_F1_LOSS:
        failures.append(f"mean F1 {f1:.3f}, without faults {baseline['f1']:.3f}")
    count = sum(faults.values())
    times = f"{p50:.2f} s / {p99:.2f} s | {baseline['f1']:.3f} / {f1:.3f} | {len(lost)}"
    table = (
        "| runs | faults | tracebacks | ended | recovered | time to recover p50 / p99 | F1 without / with | lost |",
        "| --- | --- | --- | --- | --- | --- | --- | --- |",
        f"| {len(rows)} | {count} | {len(tracebacks)} | {len(ended)} | {count - len(unrecovered)} | {times} |",
        "",
        f"Faults: {', '.join(f'{kind} {number}' for kind, number in sorted(faults.items()))}.",
    )
    figures = {
        "baseline": baseline,
        "runs": rows,
        "told": dict(told),
        "p50_s": float(p50),
        "p99_s": float(p99),
        "f1": f1,
    }
    return PartReport(tuple(failures), table, figures)
