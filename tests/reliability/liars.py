"""Sensors that lie: wheels, gyro and accelerometer whose numbers are well formed and wrong, on the demo's drive."""

import os
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from edgemap.evaluation.objects import score_map
from edgemap.geometry.camera.imu import ImuSamples
from edgemap.runtime.frames.frame import Frame
from edgemap.runtime.frames.trajectory import Trajectory
from edgemap.runtime.inputs.cameras.wheels import read_wheels
from edgemap.runtime.step.slam import build_slam
from reliability.demo_slam import DemoDrive
from reliability.parts import PartReport
from reliability.sensor_lies import GYRO_LIES, WHEEL_LIES, Lie, imu_of

FRAMES, MOST_SEEDS = 250, 3
MAX_F1_LOSS = 0.05  # of the map against the camera's alone
NAMED_WITHIN_S = 20.0


@dataclass(frozen=True, slots=True)
class Outcome:
    """What one run mapped, and what it said. faults: stamp and text. named_s: until the guilty sensor was named, from
    the lie on; infinite where it never was. first: whether no other sensor was blamed before."""

    found: int
    extra: int
    f1: float
    faults: tuple[tuple[float, str], ...]
    error_m: float

    def named_s(self, lie: Lie) -> float:
        """From the lie on until its sensor was named; infinite where it never was."""
        said = [stamp_s for stamp_s, text in self.faults if stamp_s >= lie.since_s and lie.sensor in text]
        return said[0] - lie.since_s if said else float("inf")

    def blamed_first(self, lie: Lie) -> str:
        """The first fault from the lie on that names another sensor before the guilty one; empty where none does."""
        named = self.named_s(lie) + lie.since_s
        others = [text for stamp_s, text in self.faults if lie.since_s <= stamp_s < named]
        return others[0] if others else ""

    def taken_back(self, lie: Lie) -> bool:
        """Whether the sensor was said to be used again after the lie."""
        return any(s >= lie.until_s and lie.sensor in text and "used again" in text for s, text in self.faults)


def drive(demo: DemoDrive, wheels: Trajectory | None, imu: ImuSamples | None) -> Outcome:
    """One run of the demo with these sensors; None for none."""
    camera = demo.camera
    camera.update_info(wheel=wheels)
    slam, faults = build_slam(camera, demo.bundle, demo.floor), []
    last_s, result = -np.inf, None
    for index, (image, stamp_s) in enumerate(zip(demo.images, demo.stamps_s, strict=True)):
        samples = ImuSamples.none() if imu is None else imu.between(last_s, stamp_s)
        result = slam.step(Frame(index, stamp_s, image, imu=samples))
        faults += [(stamp_s, fault.text) for fault in result.observed.faults]
        last_s = stamp_s
    score = score_map(slam.objects(), demo.truth)
    error_m = 0.0
    if result is not None and camera.info.truth is not None:
        true = camera.info.truth.from_start().at(demo.stamps_s[-1])
        error_m = float(np.hypot(*(result.pose_map_base.vector() - true.vector())[:2]))
    found = score["objects_found"]
    return Outcome(found, score["objects_mapped"] - found, score["f1"] or 0.0, tuple(faults), error_m)


def run(seed: int, share: float, out: Path | None, spec: str | None = None) -> PartReport:
    """Every lie with as many seeds as the share allows, against the camera alone. out: not used."""
    demo = DemoDrive(FRAMES, spec)
    given = demo.camera.info.wheel
    wheels = given if isinstance(given, Trajectory) else read_wheels(str(given))
    alone = drive(demo, None, None)
    failures, figures = [], {"camera alone": alone.f1}
    for number in range(max(1, round(MOST_SEEDS * share))):
        random = np.random.default_rng((seed, number))
        imu = imu_of(demo, random)
        pairs: list[tuple[Lie, Trajectory | None, ImuSamples | None]] = []
        for lie in WHEEL_LIES:
            pairs.append((lie, lie.wheels(wheels, random), None))
        for lie in GYRO_LIES:
            pairs += [(lie, None, lie.imu(imu)), (replace(lie, name=f"{lie.name}, with wheels"), wheels, lie.imu(imu))]
        only = os.environ.get("EDGEMAP_LIES")
        for lie, told, samples in pairs:
            if only and only not in lie.name:
                continue
            found = drive(demo, told, samples)
            named_s, blamed = found.named_s(lie), found.blamed_first(lie)
            back = ("yes" if found.taken_back(lie) else "no") if lie.until_s < demo.stamps_s[-1] - 5.0 else ""
            print(f"{lie.name} ({number}): F1 {found.f1:.2f}, named after {named_s:.1f} s {blamed[:60]}", flush=True)
            figures[f"{lie.name} ({number})"] = found.f1
            if found.f1 < alone.f1 - MAX_F1_LOSS:
                failures.append(f"{lie.name}: F1 {found.f1:.2f}, the camera alone {alone.f1:.2f}")
            if lie.sensor and (named_s > NAMED_WITHIN_S or blamed):
                failures.append(f"{lie.name}: named after {named_s:.1f} s, before it {blamed or 'nothing'}")
            if back == "no":
                failures.append(f"{lie.name}: not used again")
    return PartReport(tuple(failures), figures)
