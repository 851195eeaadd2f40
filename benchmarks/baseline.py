"""`python -m edgemap.benchmarks.baseline DRIVE OUT.csv`: the benchmark's baseline, a map in sixty lines.

A detector, the ray through the middle of each box's lower edge to the floor, and the nearest object of the class within
a metre. Poses are the wheels' (`--poses truth`: the drive's own). Everything that edgemap adds is missing: footprints,
covariances, loop closure, forgetting.
"""

import csv
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
import tyro

from edgemap.geometry.camera.floor import FloorCamera
from edgemap.runtime.frames.trajectory import TrackFile
from edgemap.runtime.inputs.cameras.pictures import drive_camera
from edgemap.runtime.inputs.drives import open_drive
from edgemap.runtime.network.bundle import load_bundle
from edgemap.runtime.network.decode import Detector
from edgemap.runtime.network.store import bundle_folder

NEAREST_M, SEEN, FARTHEST_M = 1.0, 5, 6.0  # as one object; sightings of one that counts; reach of a ray


@dataclass(frozen=True)
class BaselineOptions:
    """drive: a folder with pictures, camera.yaml and wheel.csv or poses.tum. out: a CSV, as the scorer takes it."""

    drive: tyro.conf.Positional[Path]
    out: tyro.conf.Positional[Path]
    poses: Literal["wheels", "truth"] = "wheels"
    bundle: str = "edgemap-nano"
    frames: int = 600


def main(options: BaselineOptions) -> None:
    """Write the map."""
    drive, bundle = open_drive(f"drive:{options.drive}"), load_bundle(bundle_folder(options.bundle))
    camera, detect = drive_camera(drive, str(options.drive)), Detector(bundle)
    lens, mount, wheels = camera.info.intrinsics, camera.info.mount, camera.info.wheel
    poses = wheels.track().from_start() if options.poses == "wheels" and isinstance(wheels, TrackFile) else drive.truth
    if lens is None or mount is None or poses is None:
        raise SystemExit(f"{options.drive}: the baseline needs lens, mount and poses")
    floor, objects = FloorCamera(lens, mount), list[tuple[str, list[np.ndarray]]]()
    while (frame := camera.read()) is not None and frame.index < options.frames:
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
    with options.out.open("w", newline="") as file:
        rows = csv.writer(file)
        rows.writerow(("label", "x_m", "y_m"))
        rows.writerows((label, *np.mean(seen, axis=0).round(4)) for label, seen in objects if len(seen) >= SEEN)


if __name__ == "__main__":
    main(tyro.cli(BaselineOptions, description=__doc__))
