"""From a backbone's name, cfg or ONNX file to a bundle, written beside its place, proven by the runtime, then moved."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from onnx import ModelProto

from edgemap.export import parity
from edgemap.export.adopt import only_outputs, static_tensors
from edgemap.export.backbones import ADOPTED, Backbone, adopted_backbone, darknet_backbone, trained_backbone
from edgemap.export.errors import ExportError
from edgemap.export.floor.checkpoint import FloorCheckpoint, load_floor
from edgemap.export.floor.merge import OUTPUT, with_floor
from edgemap.export.odometry.checkpoint import HeadCheckpoint, load_head
from edgemap.export.odometry.paper import random_head
from edgemap.export.onnx_export import free_rows, head_to_onnx, save_model, seal
from edgemap.export.quantise import add_int8, read_calibration
from edgemap.export.torch_files import kind_of, parameter_count
from edgemap.runtime.network.bundle import load_bundle
from edgemap.runtime.network.engines import open_network
from edgemap.runtime.network.manifest import Manifest, OdometryHead, StateSpec
from edgemap.runtime.network.manifest_file import sha256_file, write_manifest
from edgemap.runtime.network.network import Compute, Tensors
from edgemap.runtime.network.store import BUNDLE_NAME, check_place, staged

OWN = "edgemap-nano", "edgemap-pico"  # detectors that were trained here and come with the package


def export_backbone(
    backbone: str,
    out: Path,
    *,
    weights: Path | None = None,
    heads: Sequence[Path] = (),
    feature: str | None = None,
    size: tuple[int, int] | None = None,
    random_seed: int | None = None,
    sources: tuple[str, ...] = (),
    calibrate: Path | None = None,
) -> Path:
    """Export a backbone with its odometry heads and floor head as a bundle folder; gives `out`.

    The bundle is named after its folder, where that is a bundle's name. backbone: yolov3, yolov3-tiny, yolox-nano; a
    Darknet .cfg, an .onnx file, or the best.pt of a detector that was trained here. weights: its .weights (for
    yolox-nano its .onnx) file; without one a known name's is fetched. heads: checkpoints of trained heads; without any,
    an untrained paper head on `feature`, where that is given. size: (width, height) in px of a Darknet input.
    random_seed: random weights instead of a file, for timing. sources: where the weights came from, for the manifest.
    calibrate: a folder of pictures, for an int8 variant. The bundle is built under another name, loaded by the runtime,
    run against its source, and renamed into place. Raises ExportError or another EdgemapError; then nothing is left,
    and an older bundle at `out` stays.
    """
    check_place(out)
    calibration = None if calibrate is None else read_calibration(calibrate)
    floor, checkpoint = _loaded(heads, feature)
    if (is_onnx(backbone) or is_trained(backbone)) and (size is not None or random_seed is not None):
        raise ExportError(f"{backbone}: --size and --random-weights are for Darknet backbones, this file is fixed")
    if weights is not None and (random_seed is not None or is_trained(backbone) or backbone.endswith(".onnx")):
        raise ExportError(f"--weights {weights}: {backbone} takes no weights file here")
    feature = checkpoint.feature if checkpoint else feature
    part = open_backbone(backbone, weights, feature, size, random_seed, sources)
    manifest = part.manifest
    manifest.name = out.name if backbone.endswith(".pt") else manifest.name
    if floor is not None:
        _join(part, floor)
    if checkpoint is None and feature is not None:
        head = random_head(manifest.detector.features[0].shape)
        checkpoint = HeadCheckpoint(head, manifest.name, feature, trained=False)
    models: dict[str, ModelProto] = {}
    if checkpoint is not None:
        manifest.odometry["paper"] = record = _head_record(checkpoint, manifest)
        manifest.measured["odometry.paper"] = checkpoint.measured
        models[record.file] = head_to_onnx(checkpoint.head, record)
    models[manifest.detector.file] = seal(free_rows(part.model, manifest.detector.input), manifest.detector)
    if BUNDLE_NAME.fullmatch(place := out.resolve().name):
        manifest.name = place  # by it `pull` copies it

    with staged(out) as stage:
        for name, model in models.items():
            save_model(model, stage / name)
            manifest.sha256[name] = sha256_file(stage / name)
        write_manifest(stage, manifest)
        manifest.parity = parity.prove(load_bundle(stage), part.reference, checkpoint and checkpoint.head, part.exact)
        if calibration is not None:
            add_int8(stage, manifest, calibration)
        write_manifest(stage, manifest)
        load_bundle(stage)
    return out


def _loaded(heads: Sequence[Path], feature: str | None) -> tuple[FloorCheckpoint | None, HeadCheckpoint | None]:
    """Floor head and odometry head. feature: as for `export_backbone`. Raises ExportError."""
    kinds = {path: kind_of(path) for path in heads}
    floors = [load_floor(path) for path in heads if kinds[path] == "floor"]
    checkpoints = [load_head(path) for path in heads if kinds[path] != "floor"]
    if len(floors) > 1 or len(checkpoints) > 1:
        raise ExportError(
            f"--head: {len(floors)} floor heads and {len(checkpoints)} odometry heads, at most one of each"
        )
    if checkpoints and feature is not None:
        raise ExportError(f"--feature {feature}: a trained head brings its own ({checkpoints[0].feature})")
    return next(iter(floors), None), next(iter(checkpoints), None)


def open_backbone(
    backbone: str,
    weights: Path | None,
    feature: str | None,
    size: tuple[int, int] | None = None,
    random_seed: int | None = None,
    sources: tuple[str, ...] = (),
) -> Backbone:
    """A backbone by name, .cfg, .onnx or best.pt, tapped where a head wants it. Raises ExportError or DownloadError."""
    if is_trained(backbone):
        return trained_backbone(backbone, feature)
    if is_onnx(backbone):
        return adopted_backbone(backbone, weights, feature, sources)
    return darknet_backbone(backbone, weights, feature, size, random_seed, sources)


def is_trained(backbone: str) -> bool:
    """Whether a backbone is a detector that was trained here: its best.pt, or our own by name."""
    return backbone.endswith(".pt") or backbone in OWN


def is_onnx(backbone: str) -> bool:
    """Whether a backbone, by name or file, is adopted from its ONNX graph and not built here."""
    return backbone.endswith(".onnx") or backbone in ADOPTED


def _join(part: Backbone, floor: FloorCheckpoint) -> None:
    """Give a backbone the output of a floor head. Raises ExportError where it reads another network's features."""
    tensors, before, manifest = static_tensors(part.model), part.reference, part.manifest
    if missing := [name for name in floor.taps if name not in tensors]:
        raise ExportError(f"floor head: {manifest.name} has no tensor {', '.join(missing)}; it is of another network")
    tapped = only_outputs(part.model, [tensors[name] for name in floor.taps])
    source = open_network(tapped.SerializeToString(), Compute())
    part.model, manifest.detector = with_floor(part.model, manifest.detector, floor.head, floor.taps)
    manifest.measured["floor"] = floor.measured | {"parameters": parameter_count(floor.head)}
    manifest.sources += tuple(text for text in floor.sources if text not in manifest.sources)

    def reference(picture: NDArray[np.float32]) -> Tensors:
        features = source.run({manifest.detector.input.name: picture})
        with torch.no_grad():
            logits = floor.head(*(torch.from_numpy(features[name]) for name in floor.taps))
        return before(picture) | {OUTPUT: logits.sigmoid().numpy()}

    part.reference = reference


def _head_record(checkpoint: HeadCheckpoint, manifest: Manifest) -> OdometryHead:
    (feature,), head, name = manifest.detector.features, checkpoint.head, manifest.name
    if head.shape != feature.shape:
        raise ExportError(f"paper head takes features {head.shape}, {feature.name} of {name} has {feature.shape}")
    states = tuple(
        StateSpec(input=f"{word}_in", output=f"{word}_out", shape=shape) for word, shape in head.state_shapes.items()
    )
    forward, left, yaw = checkpoint.sigma
    return OdometryHead(
        file="odometry.paper.onnx",
        kind="paper",
        feature=feature.name,
        feature_input="feature",
        motion="motion",
        states=states,
        parameters=parameter_count(head),
        trained=checkpoint.trained,
        window=checkpoint.window,
        sigma_forward_m=forward,
        sigma_left_m=left,
        sigma_yaw_rad=yaw,
    )
