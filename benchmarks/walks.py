"""`python -m edgemap.benchmarks.walks c2w:DIR...`: carried cameras, several runs each, since a single run varies.

Every drive is followed and mapped once for each number of corners, which randomises the runs. Drift is over segments
that start at every frame, as such drives are short. Figures are means over the runs and the worst one.
"""

from collections.abc import Sequence
from dataclasses import replace
from json import dumps
from math import degrees
from typing import Annotated, Any

import numpy as np
import tyro

from edgemap.benchmarks.map_variants import replayed, true_objects
from edgemap.benchmarks.odometry import attitude_errors
from edgemap.evaluation.objects import score_map
from edgemap.evaluation.odometry import errors_of, figures, mean
from edgemap.evaluation.trajectory import integrated, path_m
from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.trajectory import Trajectory
from edgemap.runtime.inputs.drives import Drive, open_drive
from edgemap.runtime.network.bundle import Bundle
from edgemap.runtime.network.open_bundle import open_bundle
from edgemap.runtime.network.store import LENS, bundle_folder
from edgemap.runtime.step.config import Config
from edgemap.runtime.step.frame_observations import FrameObservations
from edgemap.runtime.step.slam import SlamOptions

LENGTHS_M = (1.0, 2.0, 5.0)
WINDOWS_S = (1.0, 5.0)
LOST = "blind"  # as of `Motion.members`
FIGURES = ("t_rel_1", "t_rel_2", "t_rel_5", "r_rel_5", "scale", "lost", "tilt", "tilt_max", "nees_1", "nees_5", "f1")
LOW_IS_WORSE = (
    "f1", "precision", "recall", "covered95", "rooms_found", "rooms_iou", "doors_precision", "doors_recall",
    "f1_iou25", "mean_iou",
)  # fmt: skip


def main(
    data: tyro.conf.Positional[tuple[str, ...]],
    corners: tuple[int, ...] = (144, 152, 160, 168, 176),
    depth: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False,
    odometry: str = "hybrid",
    bundle: str = "edgemap-pico",
    frames: int | None = None,
    without_wheels: bool = False,
    without_imu: bool = False,
    json: bool = False,
) -> None:
    """Follow, map, score, and print a line of means and one of worst figures for each drive. data: drives with true
    poses and a mount. corners: that are tracked, one run for each number. depth: use the drive's depth pictures.
    frames: the first ones, all by default."""
    loaded = open_bundle(bundle_folder(bundle), LENS, pace="files")
    how = SlamOptions(odometry, not without_wheels, not without_imu)
    document: dict[str, Any] = {}
    for spec in data:
        drive = open_drive(spec)
        drive = drive if depth else replace(drive, depth=())
        rows = [walk(drive, loaded, with_corners(count), how, frames) for count in corners]
        document[spec] = {"runs": rows, **summary(rows)}
        if not json:
            print("\n".join(table(spec, document[spec])), flush=True)
    if json:
        print(dumps(document, indent=1))


def with_corners(count: int) -> Config:
    """The tree with this number of corners."""
    tree = Config()
    rule = tree.odometry.pictures
    rule = replace(rule, corners=replace(rule.corners, corners=count))
    return replace(tree, odometry=replace(tree.odometry, pictures=rule))


def walk(
    drive: Drive, bundle: Bundle, config: Config, how: SlamOptions, frames: int | None = None
) -> dict[str, float | None]:
    """The figures of one run over one drive."""
    if drive.truth is None or drive.mount is None:
        raise SystemExit(f"{drive.folder}: no true poses, or no mount")
    observed = list[FrameObservations]()
    slams = replayed(drive, bundle, {"": how}, frames, config, lambda _, result: observed.append(result.observed))
    motions, stamps_s = [one.motion for one in observed[1:]], [one.stamp_s for one in observed]
    covariances = np.array([one.covariance for one in motions])
    errors = walk_errors(drive.truth, stamps_s, [one.motion for one in motions], covariances)
    states = [one.members.get("camera", LOST if one.blind or one.faults else "") for one in motions]
    tilt = attitude_errors(observed, drive.attitudes, drive.mount.height_m)
    known = tilt["pitch_rms_deg"] is not None
    truth = true_objects(drive, frames)
    return errors | {
        "lost": states.count(LOST),
        "tilt": float(np.hypot(tilt["pitch_rms_deg"], tilt["roll_rms_deg"])) if known else None,
        "tilt_max": tilt["max_deg"],
        "f1": score_map(slams[""].objects(), truth)["f1"] if truth else None,
    }


def walk_errors(
    truth: Trajectory, stamps_s: Sequence[float], steps: Sequence[SE2], covariances: np.ndarray
) -> dict[str, float | None]:
    """Errors of the motions between N stamps: drift in percent over each length, degrees per metre over the longest,
    path length divided by the true one, and NEES per degree of freedom over windows of time (1 is consistent)."""
    true, found = [truth.at(stamp_s) for stamp_s in stamps_s], integrated(steps)
    errors = errors_of(true, found, covariances, LENGTHS_M, np.array(stamps_s), step=1)
    pooled = figures([errors])
    row = {f"t_rel_{length}": value for length, value in pooled["t_rel_percent"].items()}
    row["r_rel_5"] = pooled["r_rel_deg_per_m"]["5"]
    row["scale"] = float(path_m(found)[-1] / max(errors.path_m, 1e-9))
    row |= {f"nees_{length:g}": mean(errors.window_nees[length] / 3.0) for length in WINDOWS_S}
    x_m, y_m, yaw_rad = errors.from_start[-1]
    return row | {"end_m": float(np.hypot(x_m, y_m)), "end_deg": abs(degrees(yaw_rad))}


def summary(
    rows: Sequence[dict[str, float | None]], names: Sequence[str] = FIGURES
) -> dict[str, dict[str, float | None]]:
    """Means over runs or homes, and the worst of each figure: the lowest share, the scale farthest from 1, else the
    largest. Null figures are left out."""
    known = {key: np.array([row[key] for row in rows if row[key] is not None], dtype=float) for key in names}
    worst = {key: _worst(key, values) for key, values in known.items()}
    return {"mean": {key: mean(values) for key, values in known.items()}, "worst": worst}


def table(name: str, found: dict[str, Any]) -> list[str]:
    """A heading and two lines."""
    lines = [f"{name}, {len(found['runs'])} runs", " ".join(f"{key:>8}" for key in ("", *FIGURES))]
    for kind in ("mean", "worst"):
        cells = [f"{value:>8.2f}" if value is not None else f"{'–':>8}" for value in found[kind].values()]
        lines.append(" ".join([f"{kind:>8}", *cells]))
    return lines


def _worst(key: str, values: np.ndarray) -> float | None:
    if not len(values):
        return None
    if key == "scale":
        return float(values[np.abs(np.log(values)).argmax()])
    return float(values.min() if key in LOW_IS_WORSE else values.max())


if __name__ == "__main__":
    tyro.cli(main, description=__doc__)
