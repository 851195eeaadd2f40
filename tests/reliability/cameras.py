"""Runs of the demo with ten random camera faults each, through the real camera classes on an injected clock."""

import math
import traceback
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np

from edgemap.evaluation.objects import score_map
from edgemap.geometry.errors import EdgemapError
from edgemap.geometry.map_object import MapObject
from edgemap.runtime.inputs.cameras.live import LiveCamera
from edgemap.runtime.step.loop import run as drive
from edgemap.runtime.step.sinks import Sink
from edgemap.runtime.step.slam import StepResult
from reliability.demo_slam import DemoDrive
from reliability.faulty_camera import (
    CaptureDriver,
    FaultyDriver,
    FaultyWorld,
    PlannedFault,
    plan,
)
from reliability.parts import PartReport

RUNS, FAULTS = 100, 10
CONTROLS = 10
MAX_F1_LOSS = 0.02
SAME_M = 0.5
GAP_S = 0.15  # between two frames at 10 Hz: one is missing
LOST_S = 2.0


class _Watch(Sink):
    """A sink that notes when frames came, what faults were told, and objects that a fault or a missing frame cost.

    An object is lost where it was on the map before, and for `LOST_S` after it neither it, nor what it became part of,
    nor one like it is: overlap suppression takes doubtful objects off the map for single steps without any fault.
    """

    name = "watch"

    def __init__(self, world: FaultyWorld) -> None:
        self._world = world
        self.frames_s: list[float] = []
        self.told: Counter[str] = Counter()
        self.lost: list[str] = []
        self.unsound = 0
        self._before: list[MapObject] = []
        self._missed: list[tuple[float, MapObject]] = []  # since when
        self._stamp_s = math.inf

    def write(self, result: StepResult, objects: list[MapObject]) -> None:
        """One frame."""
        self.told.update(fault.kind.value for fault in result.faults)
        stamp_s = result.frame.stamp_s
        if result.faults or stamp_s - self._stamp_s > GAP_S:
            self._missed += [(stamp_s, item) for item in self._before]
        now = {item.id for item in objects}
        away = [(since_s, item) for since_s, item in self._missed if result.merged.get(item.id) not in now]
        away = [(since_s, item) for since_s, item in away if not any(_like(item, other) for other in objects)]
        self.lost += [item.id for since_s, item in away if stamp_s - since_s > LOST_S]
        self._missed = [(since_s, item) for since_s, item in away if stamp_s - since_s <= LOST_S]
        self._stamp_s = stamp_s
        self.unsound += not np.isfinite(result.pose_map_base.vector()).all()
        self.unsound += not (np.linalg.eigvalsh(result.pose_covariance) > -1e-12).all()
        self._before = objects
        self.frames_s.append(self._world.now_s)


def _like(item: MapObject, other: MapObject) -> bool:
    """The same object, or one of its label where it stood."""
    near = float(np.linalg.norm(item.position_m - other.position_m)) < SAME_M
    return item.id == other.id or (item.label == other.label and near)


def run(seed: int, share: float, out: Path) -> PartReport:
    """A webcam with faults in every run, with a hardware reset in half of them. out: not used."""
    demo = DemoDrive()
    baseline = _one(demo, [])
    controls = [_one(demo, [], _but_a_few(demo, seed, number)) for number in range(CONTROLS)]
    rows = []
    for number in range(max(1, round(RUNS * share))):
        faults = plan(np.random.default_rng((seed, number)), FAULTS, demo.stamps_s[0] + 2.0, demo.stamps_s[-1] - 5.0)
        rows.append(_one(demo, faults, resets=number % 2 == 0))
        print(f"cameras: run {number}: F1 {rows[-1]['f1']:.3f} {rows[-1]['failure']}", flush=True)
    return _report(baseline, controls, rows)


def _but_a_few(demo: DemoDrive, seed: int, number: int) -> list[int]:
    """The drive without `FAULTS` single frames, which is no fault: by how much F1 varies between runs like this one."""
    missing = np.random.default_rng((seed, number, 1)).choice(len(demo.images), FAULTS, replace=False)
    return sorted(set(range(len(demo.images))) - set(missing.tolist()))


def _one(
    demo: DemoDrive, faults: list[PlannedFault], frames: list[int] | None = None, resets: bool = False
) -> dict[str, Any]:
    chosen = range(len(demo.images)) if frames is None else frames
    images, stamps_s = [demo.images[i] for i in chosen], [demo.stamps_s[i] for i in chosen]
    world = FaultyWorld(images, stamps_s, faults, demo.stamps_s[0])
    slam, watch, failure = demo.slam(), _Watch(world), ""
    try:
        driver = FaultyDriver(world, CaptureDriver(world), resets)
        with LiveCamera(driver, demo.floor.intrinsics, demo.floor.mount, None, world.clock_s, world.wait) as camera:
            drive(camera, slam, [watch], None, world.stop)
    except EdgemapError as error:
        failure = f"ended: {error}"
    except Exception:
        failure = f"traceback: {traceback.format_exc()}"
    recovered = [(fault.kind, _recovery_s(fault, watch.frames_s)) for fault in faults if fault.begun]
    return {
        "f1": score_map(slam.objects(), demo.truth)["f1"] or 0.0, "failure": failure, "frames": len(watch.frames_s),
        "told": dict(watch.told), "recover_s": recovered, "lost": watch.lost, "unsound": watch.unsound,
    }  # fmt: skip


def _recovery_s(fault: PlannedFault, frames_s: list[float]) -> float | None:
    """From the end of the cause, or the beginning where only the supervisor ends it, to the next frame."""
    after = [stamp_s for stamp_s in frames_s if stamp_s >= fault.over_s] if fault.over else []
    return after[0] - fault.since_s if after else None


def _report(baseline: dict[str, Any], controls: list[dict[str, Any]], rows: list[dict[str, Any]]) -> PartReport:
    told = Counter[str]()
    for row in rows:
        told.update(row["told"])
    recover = [(kind, seconds) for row in rows for kind, seconds in row["recover_s"]]
    unrecovered = [kind for kind, seconds in recover if seconds is None]
    f1, control = (float(np.mean([row["f1"] for row in some])) for some in (rows, controls))
    tracebacks = [row["failure"] for row in rows if row["failure"].startswith("traceback")]
    ended = [row["failure"] for row in rows if row["failure"].startswith("ended")]
    lost = [identity for row in rows for identity in row["lost"]]
    unsound = sum(row["unsound"] for row in rows)
    failures = [f"{len(tracebacks)} tracebacks: {tracebacks[0]}"] if tracebacks else []
    failures += [f"{len(ended)} runs ended: {ended[0]}"] if ended else []
    failures += [f"not recovered: {Counter(unrecovered)}"] if unrecovered else []
    failures += [f"objects lost over a fault: {lost}"] if lost else []
    failures += [f"{unsound} poses or covariances that are none"] if unsound else []
    if baseline["f1"] - f1 > MAX_F1_LOSS:
        failures.append(f"mean F1 {f1:.3f}, without faults {baseline['f1']:.3f}")
    figures = {"baseline": baseline, "controls": controls, "runs": rows, "told": dict(told), "f1": [f1, control]}
    return PartReport(tuple(failures), figures | {"lost_of_controls": sum(len(row["lost"]) for row in controls)})
