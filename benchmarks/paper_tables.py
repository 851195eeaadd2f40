"""`python -m edgemap.benchmarks.paper_tables --seeds A:B -o DIR`: the paper's Tables 2 to 5 for our data, on one page.

Homes are rendered by `edgemap simulate` (kept in DIR and resumed), or `--data` names drives that exist: drive:DIR,
kitti:DIR and so on, `demo`. DIR/paper_tables.md has the tables with the paper's own figures beside them,
DIR/paper_tables.json every figure, DIR/ways/ the ways over the true ones (the paper's Fig. 7).
"""

import json
import sys
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tyro

from edgemap.benchmarks.odometry import OWN_WHEELS, ScoredDrive, Selection, score_drive, sequence_names, together
from edgemap.benchmarks.paper_page import page
from edgemap.benchmarks.rooms import rendered
from edgemap.evaluation.detection import Counts, ScoredPicture, counts_by_class
from edgemap.geometry.errors import EdgemapError
from edgemap.runtime.inputs.drives import READERS, open_drive
from edgemap.runtime.inputs.drives.open import labelled_pictures
from edgemap.runtime.inputs.open import DEMO
from edgemap.runtime.network.bundle import Bundle, load_bundle
from edgemap.runtime.network.decode import Decoder, Detector
from edgemap.runtime.network.engines import compute_at
from edgemap.runtime.network.store import bundle_folder
from edgemap.runtime.step.slam import SlamOptions

COUNTED = 100  # frames of each sequence in which detections are counted, as in the paper
# Column to what it runs; the camera is alone in all but the last two.
ODOMETRIES = {
    "hybrid": ("hybrid", False),
    "paper head": ("paper", False),
    "hybrid with wheels": ("hybrid", True),
    "wheels": (OWN_WHEELS, True),
}


def main(
    seeds: str | None = None,
    data: tuple[str, ...] = (),
    bundle: str = "edgemap-nano",
    frames: int = 450,
    threads: int | None = None,
    out: Annotated[Path, tyro.conf.arg(aliases=["-o"])] = Path("runs/paper-tables"),
) -> None:
    """Render where needed, measure, and write page and figures. seeds: A:B, homes from A up to, not including, B. data:
    drives that exist, instead. frames: first N of each."""
    try:
        loaded = load_bundle(bundle_folder(bundle), compute_at("files", threads))
        specs = [f"drive:{DEMO}" if spec == "demo" else spec for spec in data] or [
            f"drive:{home}" for home in rendered(seeds or "", frames, out / "drives")
        ]
        document = measure(dict(zip(sequence_names(specs), specs, strict=True)), loaded, frames, out)
        out.mkdir(parents=True, exist_ok=True)
        (out / "paper_tables.json").write_text(json.dumps(document, indent=1) + "\n")
        (out / "paper_tables.md").write_text(page(document))
    except EdgemapError as error:
        sys.exit(f"paper_tables: {error}")
    print(out / "paper_tables.md")


def measure(specs: dict[str, str], bundle: Bundle, frames: int | None, out: Path) -> dict[str, Any]:
    """All figures of the drives, by name. Draws their ways into `out`/ways/ where matplotlib is there."""
    scored: dict[str, dict[str, ScoredDrive]] = {}
    lacking: dict[str, str] = {}
    head = bundle.manifest.odometry.get("paper")
    if head is None or not head.trained:
        lack = "the bundle has no paper head" if head is None else "the bundle's paper head is untrained"
        lacking["paper head"] = lack
    for column, (odometry, wheels) in ODOMETRIES.items():
        if column in lacking:
            continue
        scored[column] = {}
        for name, spec in specs.items():
            if wheels and (spec.partition(":")[0] not in READERS or open_drive(spec).wheel is None):
                continue
            print(f"{column}: {name}", file=sys.stderr, flush=True)
            scored[column][name] = score_drive(spec, SlamOptions(odometry, wheels), bundle, Selection(frames=frames))
        if not scored[column]:
            del scored[column]
            lacking[column] = "no wheel odometry in the data"
    return {
        "bundle": bundle.manifest.name,
        "data": specs,
        "frames": frames,
        "detections": {name: _detections(spec, bundle, frames) for name, spec in specs.items()},
        "odometry": {column: together(drives) for column, drives in scored.items()},
        "columns": list(ODOMETRIES),
        "lacking": lacking,
        "parameters": {kind: one.parameters for kind, one in bundle.manifest.odometry.items()},
        "ways": _ways(scored, out / "ways"),
        "threads": bundle.compute.threads,
    }


def _detections(spec: str, bundle: Bundle, frames: int | None) -> dict[str, Any] | None:
    """Counts in some frames of a drive, chosen by a fixed seed; None where its true boxes are not known."""
    if spec.partition(":")[0] not in READERS or not (drive := open_drive(spec)).boxes:
        return None
    count = len(drive.boxes[:frames])
    chosen = set(np.random.default_rng(0).choice(count, min(COUNTED, count), replace=False).tolist())
    detector = Detector(bundle, Decoder(bundle.manifest.detector, bundle.manifest.confidence, one_name=True))
    number = {name: index for index, name in enumerate(bundle.names)}
    pictures = []
    for index, (image, truth) in enumerate(labelled_pictures(drive, frames)):
        if index not in chosen:
            continue
        found = detector(image)
        pictures.append(ScoredPicture.compare(truth.boxes, truth.labels, truth.ignorable(), found, number))
    counted = counts_by_class(pictures)
    rows = dict[str, dict[str, int]]()
    for name, labels in (("chair", {"chair"} & bundle.mapped), ("mapped", bundle.mapped)):
        one = sum((counted.get(number[label], Counts()) for label in labels), Counts())
        rows[name] = {key: one[key] for key in ("true", "found", "false")} | {"missed": one["true"] - one["found"]}
    return {"frames": len(pictures), "score": bundle.manifest.confidence, **rows}


def _ways(scored: dict[str, dict[str, ScoredDrive]], folder: Path) -> dict[str, str]:
    """Draw each drive's ways from the camera alone, and with wheels; the pictures by the drive's name."""
    try:
        from edgemap.plots.trajectories import plot_ways
    except EdgemapError as error:
        print(f"no pictures of the ways: {error}", file=sys.stderr)
        return {}
    drawn: dict[str, str] = {}
    for name in dict.fromkeys(name for drives in scored.values() for name in drives):
        ways = {column: drives[name] for column, drives in scored.items() if name in drives}
        file = f"{''.join(letter if letter.isalnum() else '-' for letter in name)}.png"
        true = next(iter(ways.values())).true
        plot_ways(folder / file, name, true, {column: way.estimated for column, way in ways.items()})
        drawn[name] = f"{folder.name}/{file}"
    return drawn


if __name__ == "__main__":
    tyro.cli(main, description=__doc__)
