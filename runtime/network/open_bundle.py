"""A bundle as a run uses it: one of ours or a detector of another project, with a companion for the floor."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from edgemap.runtime.frames.inference import Engine, Precision
from edgemap.runtime.network.bundle import Bundle, load_bundle
from edgemap.runtime.network.engines import Pace, open_onnxruntime
from edgemap.runtime.network.foreign import load_foreign
from edgemap.runtime.network.manifest_file import read_manifest, verified_file
from edgemap.runtime.network.store import bundle_folder
from edgemap.runtime.network.subgraph import subgraph


def open_bundle(
    source: Path,
    companion: str | None,
    threads: int | None = None,
    precision: Precision = "float32",
    pace: Pace = "camera",
    engine: Engine = "onnxruntime",
    names: Sequence[str] | None = None,
) -> Bundle:
    """A bundle's folder or a detector's FILE.onnx, ready for a run. Raises BundleError.

    companion: the bundle whose trunk shows the floor beside a detector without a head for it; None where no floor is
    needed. names: of the classes of a FILE.onnx.
    """
    foreign = source.suffix == ".onnx"
    beside = companion is not None and (foreign or read_manifest(source).detector.floor is None)
    threads = (threads or 1) if beside else threads  # two networks at once
    loaded = (
        load_foreign(source, threads, pace, names) if foreign else load_bundle(source, threads, precision, pace, engine)
    )
    if companion is None or not beside:
        return loaded
    return replace(loaded, companion=load_companion(bundle_folder(companion), threads, pace), paced=pace == "camera")


def load_companion(folder: Path, threads: int | None = None, pace: Pace = "camera") -> Bundle:
    """A bundle whose backbone is cut down to the floor mask. Raises BundleError."""
    whole = load_bundle(folder, threads, pace=pace)
    detector = whole.manifest.detector
    kept = {detector.floor.name} if detector.floor else set()
    model = subgraph(verified_file(folder, whole.manifest, detector.file).read_bytes(), kept)
    reopen = lambda rows: open_onnxruntime(model, whole.compute, rows)  # noqa: E731
    return replace(whole, backbone=reopen(detector.input.height), reopen=reopen)
