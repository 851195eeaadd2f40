"""Writes a bundle beside its place, proves it with the runtime's own loader, and only then puts it there."""

from collections.abc import Callable
from pathlib import Path

import msgspec
from onnx import ModelProto

from edgemap.export.calibration import Calibration
from edgemap.export.onnx_export import save_model
from edgemap.export.quantise import add_int8
from edgemap.runtime.network.bundle import Bundle, load_bundle
from edgemap.runtime.network.manifest import Manifest, Parity, sha256_file, write_manifest
from edgemap.runtime.network.store import staged

Proof = Callable[[Bundle], dict[str, Parity]]


def write_bundle(
    out: Path, manifest: Manifest, models: dict[str, ModelProto], proof: Proof, calibration: Calibration | None = None
) -> Path:
    """Write models and manifest to the folder `out`; the manifest's sums and parity are filled in here.

    The bundle is built under another name, loaded by the runtime, run against its source by `proof`, given an int8
    variant where there are pictures for its calibration, and renamed into place. Raises ExportError or BundleError;
    then nothing is left and an older bundle at `out` stays.
    """
    with staged(out) as stage:
        for name, model in models.items():
            save_model(model, stage / name)
        sums = {name: sha256_file(stage / name) for name in models}
        manifest = msgspec.structs.replace(manifest, sha256=sums)
        write_manifest(stage, manifest)
        parity = proof(load_bundle(stage))
        write_manifest(stage, msgspec.structs.replace(manifest, parity=parity))
        if calibration is not None:
            add_int8(stage, calibration)
        proven = load_bundle(stage)
        for kind in proven.manifest.odometry:
            proven.odometry_head(kind)
    return out
