"""The entries of run.json that are fixed before the first frame."""

import platform
from dataclasses import asdict
from datetime import UTC, datetime
from importlib.metadata import version
from typing import Any

import msgspec

from edgemap import __version__
from edgemap.cli.run_options import RunOptions
from edgemap.geometry.camera.floor import FloorCamera
from edgemap.runtime.compose import optics_record
from edgemap.runtime.frames.camera import Camera
from edgemap.runtime.frames.inference import Inference
from edgemap.runtime.motion.odometry_names import HYBRID
from edgemap.runtime.network.bundle import Bundle
from edgemap.runtime.step.config import Config


def run_record(
    options: RunOptions,
    source: Camera,
    loaded: Bundle,
    floor: FloorCamera,
    confidence: float,
    mapped: frozenset[str],
    tuned: Config,
) -> dict[str, Any]:
    """Source, camera, bundle, options and the resolved configuration. confidence: minimum score of a box."""
    record: dict[str, Any] = {
        "format": "edgemap.run/1",
        "started_utc": datetime.now(UTC).isoformat(timespec="seconds"),
        "camera": source.info.name,
        "source": list(source.info.notes),
        **optics_record(floor),
        "bundle": {"name": loaded.manifest.name, "folder": str(loaded.folder), "sha256": loaded.manifest.sha256},
        "odometry": options.robot.odometry,
        "clustering": options.map.clustering,
        "confidence": confidence,
        "mapped": sorted(mapped),
        "threads": loaded.compute.threads,
        "spinning": loaded.compute.spin,
        "engine": loaded.compute.engine,
        "precision": loaded.precision,
        "versions": {"edgemap": __version__}
        | {name: version(name) for name in ("onnxruntime", "numpy", "opencv-python-headless")},
        "machine": {"system": platform.platform(), "python": platform.python_version()},
        "trajectory": "as known at the end",
    }
    if options.map.saved:
        place = options.map.place()
        continued = place is not None and place.exists  # the first run by a name makes the map
        record |= {"map": str(options.map.saved), "start": options.map.start, "map_continued": continued}
    # Engine and precision where they were asked for, or are not the defaults: a recording may bring them.
    inputs, usual = options.inputs(), asdict(Inference())
    decided = asdict(Inference(loaded.compute.engine, loaded.precision)).items()
    inputs |= {name: one for name, one in decided if name in inputs or one != usual[name]}
    return record | {"options": inputs, "config": msgspec.to_builtins(tuned)}


def scale_source(record: dict[str, Any]) -> str:
    """What gave a run its scale, from the record of its run.json; empty: the height of the lens. Raises TypeError,
    ValueError, AttributeError and OverflowError where the record is damaged.
    """
    if record.get("map") and record.get("map_continued", True):
        return "a saved map, and the runs before it,"
    if int(record.get("quality", {}).get("wheel_frames", 0)):
        return "wheels"
    if int(record.get("attitude_sources", {}).get("depth", 0)):
        return "depth"
    odometry = str(record.get("odometry", ""))
    return "" if odometry == HYBRID else odometry
