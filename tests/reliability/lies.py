"""Sixty lies of poses, wheels, depth and IMU on three rendered homes: is the guilty one named, is a wrong map good?"""

import json
import math
import shutil
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from edgemap.benchmarks.map_variants import true_objects
from edgemap.evaluation.objects import score_map
from edgemap.runtime.inputs.drives import open_drive
from edgemap.runtime.inputs.drives.camera_yaml import read_camera_yaml
from edgemap.runtime.step.map_file import load_map
from reliability.parts import PartReport

Array = NDArray[np.float64]
Change = Callable[[Array, float], Array]  # of a table's rows, by a size
Faults = list[tuple[str, str]]  # kind and text
OPTICAL = "optical axes"
HOMES, FRAMES = (9001, 9003, 9260), 150
WRONG_F1 = 0.1  # below the map with the honest sensor
NAMED, LIES_NAMED = 50, 60
KINDS = {"poses": "poses_", "wheels": "wheels_", "depth": "depth_", "imu": "imu_"}
SENSORS = tuple(KINDS.values())


@dataclass(frozen=True, slots=True)
class Lie:
    """A lie. sizes: the least and the largest, drawn in between. change: of the sensor's rows; none for depth,
    whose scale is the size."""

    sensor: str
    name: str
    sizes: tuple[float, float]
    change: Change | None = None


def _columns(*factors: tuple[int, float]) -> Change:
    """Columns times numbers; 0 stands for the size."""

    def change(rows: Array, size: float) -> Array:
        rows = rows.copy()
        for column, factor in factors:
            rows[:, column] *= factor or size
        return rows

    return change


def _late(rows: Array, size: float) -> Array:
    return rows + np.eye(1, rows.shape[1])[0] * size


def _yaw(rows: Array, size: float) -> Array:
    """Poses whose heading is `size` times as large."""
    yaw = size * np.unwrap(2.0 * np.arctan2(rows[:, 6], rows[:, 7]))
    return np.column_stack([rows[:, :4], np.zeros((len(rows), 2)), np.sin(yaw / 2.0), np.cos(yaw / 2.0)])


def _optical(rows: Array, size: float) -> Array:
    """Poses of a camera that looks down by `size`, the mount's pitch, in the first one's axes, as of ORB-SLAM3."""
    poses = np.tile(np.eye(4), (len(rows), 1, 1))
    poses[:, :3, :3], poses[:, :3, 3] = Rotation.from_quat(rows[:, 4:]).as_matrix(), rows[:, 1:4]
    lens = np.eye(4)
    lens[:3, :3] = Rotation.from_euler("y", size).as_matrix() @ [[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]]
    poses = np.linalg.inv(poses[0] @ lens) @ poses @ lens
    return np.column_stack([rows[:, 0], poses[:, :3, 3], Rotation.from_matrix(poses[:, :3, :3]).as_quat()])


LIES = (
    Lie("poses", OPTICAL, (0.0, 0.0), _optical),
    Lie("poses", "w first", (1.0, 1.0), lambda rows, _: rows[:, [0, 1, 2, 3, 7, 4, 5, 6]]),
    Lie("poses", "scale", (0.4, 0.75), _columns((1, 0), (2, 0), (3, 0))),
    Lie("poses", "millimetres", (1000.0, 1000.0), _columns((1, 0), (2, 0), (3, 0))),
    Lie("poses", "mirrored", (1.0, 1.0), _columns((2, -1.0), (6, -1.0))),
    Lie("poses", "late", (0.2, 1.0), _late),
    Lie("poses", "another clock", (100.0, 1e6), _late),
    Lie("poses", "yaw", (1.3, 1.8), _yaw),
    Lie("wheels", "scale", (1.4, 1.8), _columns((1, 0), (2, 0))),
    Lie("wheels", "mirrored", (1.0, 1.0), _columns((2, -1.0), (3, -1.0))),
    Lie("wheels", "degrees", (math.degrees(1.0), math.degrees(1.0)), _columns((3, 0))),
    Lie("wheels", "late", (0.2, 1.0), _late),
    Lie("depth", "too short", (0.2, 0.7)),
    Lie("depth", "too long", (1.5, 4.0)),
    Lie("imu", "gyro reversed", (1.0, 1.0), _columns((1, -1.0), (2, -1.0), (3, -1.0))),
    Lie("imu", "gyro's axes", (1.0, 1.0), lambda rows, _: rows[:, [0, 3, 1, 2, 4, 5, 6]]),
    Lie("imu", "late", (0.2, 0.8), _late),
    Lie("imu", "degrees", (math.degrees(1.0), math.degrees(1.0)), _columns((1, 0), (2, 0), (3, 0))),
    Lie("imu", "gravity reversed", (1.0, 1.0), _columns((4, -1.0), (5, -1.0), (6, -1.0))),
    Lie("imu", "no force", (1.0, 1.0), lambda rows, _: rows * [1, 1, 1, 1, 0, 0, 0]),
)
FILES = {"poses": "given.tum", "wheels": "wheel.csv", "imu": "imu.csv"}
ALONE = {"poses": ("--odometry", "given.tum"), "wheels": ("--odometry", "wheel:wheel.csv")}


def edgemap(*words: object) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "edgemap.cli", *map(str, words)]
    return subprocess.run(command, capture_output=True, text=True, check=False)


def _drive(home: Path, folder: Path, lie: Lie | None, sensor: str, size: float) -> Path:
    """The home's drive with one sensor beside its pictures, which lies or not."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    for name in ("images", "boxes.json", "objects.json", "camera.yaml", "poses.tum", "floor_plan.json"):
        (folder / name).symlink_to((home / name).resolve())
    if sensor == "depth":
        (folder / "depth").mkdir()
        for path in sorted((home / "depth").iterdir()):
            scaled = np.clip(size * np.asarray(cv2.imread(str(path), cv2.IMREAD_UNCHANGED), dtype=np.float64), 0, 65535)
            cv2.imwrite(str(folder / "depth" / path.name), scaled.astype(np.uint16))
        return folder
    source = home / ("poses.tum" if sensor == "poses" else FILES[sensor])
    comma, header = (" ", "") if sensor == "poses" else (",", source.read_text().splitlines()[0].strip())
    rows = np.loadtxt(source, delimiter=None if sensor == "poses" else ",", skiprows=int(bool(header)))
    rows = lie.change(rows, size) if lie and lie.change else rows
    np.savetxt(folder / FILES[sensor], rows, "%.9f", comma, header=header, comments="")
    return folder


def accused(faults: Faults) -> Faults:
    """Those that name a sensor, in order."""
    return [fault for fault in faults if fault[0].startswith(SENSORS)]


def rendered(homes: Path, number: int) -> Path:
    """The drive through a home, with all sensors; rendered once."""
    if not (homes / str(number) / "poses.tum").is_file():
        edgemap("simulate", "--seed", number, "--frames", FRAMES, "--depth", "--imu", "-o", homes / str(number))
    return homes / str(number)


def mapped(spec: str, out: Path, *words: object) -> tuple[str, Faults]:
    """Verdict and faults of a run; one that is refused makes no map, and its message is the fault."""
    shutil.rmtree(out, ignore_errors=True)
    done = edgemap("run", "--camera", spec, "--frames", FRAMES, "--out", out, *words)
    if not (out / "run.json").is_file() or done.returncode:
        return "refused", [("ended", (done.stdout + done.stderr)[-200:])]
    record = json.loads((out / "run.json").read_text())
    return record["verdict"]["level"], [(fault["kind"], fault["text"]) for fault in record["faults"]]


def judged(home: Path, out: Path, lie: Lie | None, sensor: str, size: float) -> tuple[float, str, Faults]:
    """F1, verdict and faults of a run with one sensor that may lie; a run that is refused may name the sensor's file.
    Kept in `out/results`, so that a part that was ended goes on."""
    kept = out / "results" / f"{home.name}-{sensor}-{lie.name if lie else 'honest'}-{size:.6g}.json"
    if kept.is_file():
        return tuple(json.loads(kept.read_text()))
    folder, file = _drive(home, out / "drive", lie, sensor, size), FILES.get(sensor, "depth")
    alone = [word.replace(file, str(folder / file)) for word in ALONE.get(sensor, ())]
    level, faults = mapped(f"drive:{folder}", out / "run", *alone)
    if level == "refused":
        f1, faults = math.nan, [(KINDS[sensor] if file in faults[0][1] else "", faults[0][1])]
    else:
        f1 = float(score_map(load_map(out / "run"), true_objects(open_drive(f"drive:{folder}"), FRAMES))["f1"] or 0.0)
    kept.parent.mkdir(exist_ok=True)
    kept.write_text(json.dumps((f1, level, faults)))
    return f1, level, faults


def run(seed: int, share: float, out: Path) -> PartReport:
    """Every lie on every home with a size of its own; a share of the lies."""
    random, table, honest = np.random.default_rng(seed), list[str](), dict[tuple[int, str], float]()
    named = wrong_good = wrongly = count = 0
    for number in HOMES:
        home = rendered(out / "homes", number)
        for sensor in KINDS:
            f1, level, faults = judged(home, out, None, sensor, 1.0)
            honest[number, sensor] = f1
            wrongly += bool(accused(faults))
            table.append(f"{number} honest {sensor}: F1 {f1:.2f}, {level} {faults[:1]}")
            print(table[-1], flush=True)
        for lie in LIES[:: max(round(1.0 / share), 1)]:
            size = float(random.uniform(*lie.sizes))
            mount = read_camera_yaml(home / "camera.yaml").mount
            size = mount.pitch_rad if mount and lie.name == OPTICAL else size
            f1, level, faults = judged(home, out, lie, lie.sensor, size)
            guilty = [kind for kind, _ in accused(faults)[:1] if kind.startswith(KINDS[lie.sensor])]
            wrong = f1 < honest[number, lie.sensor] - WRONG_F1
            count, named, wrong_good = count + 1, named + bool(guilty), wrong_good + (wrong and level == "good")
            said = faults[0][1][:90] if faults else "nothing"
            names = "named" if guilty else "NOT NAMED"
            table.append(f"{number} {lie.sensor} {lie.name} {size:.3g}: F1 {f1:.2f}, {level}, {names}: {said}")
            print(table[-1], flush=True)
    figures = {"lies": count, "named_first": named, "wrong_and_good": wrong_good, "honest_accused": wrongly}
    failures = [f"{wrong_good} wrong maps are good"] if wrong_good else []
    failures += [f"{named} of {count} named first"] if named < NAMED * count / LIES_NAMED else []
    failures += [f"{wrongly} honest sensors accused"] if wrongly else []
    shutil.rmtree(out / "results", ignore_errors=True)
    return PartReport(tuple(failures), figures, (*table, str(figures)))
