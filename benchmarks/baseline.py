"""`python -m edgemap.benchmarks.baseline HOMES OUT`: the benchmark's baseline, a map in sixty lines, and its score.

A detector, the ray through the middle of each box's lower edge to the floor, and the nearest object of the class within
a metre. Poses are the wheels' (`--poses truth`: the drive's own). Everything that edgemap adds is missing: footprints,
covariances, loop closure, forgetting.
"""

import csv
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import tyro

from edgemap.benchmarks.score import homes_of
from edgemap.benchmarks.score import main as print_score
from edgemap.geometry.camera.floor import FloorCamera
from edgemap.runtime.inputs.cameras.pictures import drive_camera
from edgemap.runtime.inputs.drives import open_drive
from edgemap.runtime.network.bundle import Bundle, load_bundle
from edgemap.runtime.network.decode import Detector
from edgemap.runtime.network.store import bundle_folder

NEAREST_M, SEEN, FARTHEST_M = 1.0, 5, 6.0  # as one object; sightings of one that counts; reach of a ray


def main(
    homes: tyro.conf.Positional[Path],
    out: tyro.conf.Positional[Path],
    poses: Literal["wheels", "truth"] = "wheels",
    bundle: str = "edgemap-nano",
    seeds: str = "",
    frames: int = 600,
    json: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False,
) -> None:
    """Map each home, and score them. homes: a drive with pictures, camera.yaml and wheel.csv or poses.tum, or a folder
    of them. out: folder of CSVs, as the scorer takes them. seeds, frames, json: as of the scorer."""
    found, loaded = homes_of(homes, seeds), load_bundle(bundle_folder(bundle))
    out.mkdir(parents=True, exist_ok=True)
    for home in found:
        if not (out / f"{home.name}.csv").exists():
            write_map(home, out / f"{home.name}.csv", loaded, poses == "wheels", frames)
    print_score(out if len(found) > 1 else out / f"{found[0].name}.csv", homes, seeds, frames, json)


def write_map(home: Path, out: Path, bundle: Bundle, wheels: bool, frames: int) -> None:
    """The map of one home."""
    drive = open_drive(f"drive:{home}")
    camera, detect = drive_camera(drive, str(home)), Detector(bundle)
    lens, mount = camera.info.intrinsics, camera.info.mount
    poses = drive.wheel.from_start() if wheels and drive.wheel is not None else drive.truth
    if lens is None or mount is None or poses is None:
        raise SystemExit(f"{home}: the baseline needs lens, mount and poses")
    floor, objects = FloorCamera(lens, mount), list[tuple[str, list[np.ndarray]]]()
    while (frame := camera.read()) is not None and frame.index < frames:
        found, pose = detect(frame.image), poses.at(frame.stamp_s)
        feet = np.column_stack([(found.boxes[:, 0] + found.boxes[:, 2]) / 2.0, found.boxes[:, 3]])
        for label, score, point in zip(found.labels, found.scores, floor.floor_points(feet), strict=True):
            cut = not np.isfinite(point).all() or np.hypot(*point) > FARTHEST_M
            if cut or score < bundle.manifest.confidence or label not in bundle.mapped:
                continue
            place = pose.apply(point[None])[0]
            near = [(np.linalg.norm(np.mean(seen, axis=0) - place), seen) for name, seen in objects if name == label]
            away_m, seen = min(near, key=lambda one: one[0], default=(np.inf, []))
            if away_m <= NEAREST_M:
                seen.append(place)
            else:
                objects.append((label, [place]))
    with out.open("w", newline="") as file:
        rows = csv.writer(file)
        rows.writerow(("label", "x_m", "y_m"))
        rows.writerows((label, *np.mean(seen, axis=0).round(4)) for label, seen in objects if len(seen) >= SEEN)


if __name__ == "__main__":
    tyro.cli(main, prog="python -m edgemap.benchmarks.baseline", description=__doc__)
