"""From a backbone's name, cfg or ONNX file to a proven bundle."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from onnx import ModelProto

from edgemap.export import architectures, parity
from edgemap.export.adopt import adopt
from edgemap.export.bundle_writer import write_bundle
from edgemap.export.checkpoint import HeadCheckpoint, load_head
from edgemap.export.coco import class_entries
from edgemap.export.convlstm import random_head
from edgemap.export.darknet import Darknet
from edgemap.export.darknet_weights import load_weights, random_weights, value_count
from edgemap.export.errors import ExportError
from edgemap.export.obtain import obtain
from edgemap.export.onnx_export import backbone_to_onnx, head_to_onnx, seal
from edgemap.export.sources import KNOWN
from edgemap.runtime.bundle import (
    FORMAT,
    Detector,
    FeatureSpec,
    HeadSpec,
    InputSpec,
    Manifest,
    OdometryHead,
    StateSpec,
    sha256_file,
)
from edgemap.runtime.session import Tensors

DARKNET = {"yolov3": architectures.yolov3, "yolov3-tiny": architectures.yolov3_tiny}
BACKBONES = (*DARKNET, "yolox-nano")
DARKNET_PAD = 127  # Darknet's letterbox fills with 0.5


@dataclass
class Backbone:
    """A detector ready to be bundled. features: export's word for a feature to the output's name."""

    name: str
    model: ModelProto
    detector: Detector
    features: dict[str, str]
    reference: parity.Reference
    exact: bool
    measured: dict[str, Any]
    licence: str
    sources: tuple[str, ...]


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
) -> Path:
    """Export a backbone and its odometry heads as a bundle folder; gives `out`.

    backbone: yolov3, yolov3-tiny, yolox-nano, a Darknet .cfg or an .onnx file. weights: its .weights (for yolox-nano
    its .onnx) file; without one a known name's is fetched. heads: checkpoints of trained heads; without any, an
    untrained paper head on `feature` (default `head`, the raw coarse map; for ONNX files `stride32`) is made and marked
    so. size: (width, height) in px of a Darknet input. random_seed: random weights instead of a file, for timing.
    sources: where the weights came from, for the manifest. Raises ExportError or another EdgemapError; then nothing is
    left at `out`.
    """
    checkpoints = [load_head(path) for path in heads]
    kinds = [checkpoint.kind for checkpoint in checkpoints]
    if len(set(kinds)) != len(kinds):
        raise ExportError(f"--head: two heads of one kind ({', '.join(kinds)})")
    if heads and feature is not None:
        raise ExportError(f"--feature {feature}: a trained head brings its own ({checkpoints[0].feature})")
    is_onnx = backbone.endswith(".onnx") or backbone == "yolox-nano"
    if is_onnx and (size is not None or random_seed is not None):
        raise ExportError(f"{backbone}: --size and --random-weights are for Darknet backbones, an ONNX file is fixed")
    if weights is not None and (random_seed is not None or backbone.endswith(".onnx")):
        raise ExportError(f"--weights {weights}: {backbone} takes no weights file here")
    wanted = [checkpoint.feature for checkpoint in checkpoints] or [feature or ("stride32" if is_onnx else "head")]
    if is_onnx:
        part = _adopted(backbone, weights, wanted, sources)
    else:
        part = _darknet(backbone, weights, wanted, size, random_seed, sources)
    if not checkpoints:
        shape = _feature_shape(part.detector, part.features[wanted[0]])
        checkpoints = [HeadCheckpoint(random_head(shape), part.name, wanted[0], trained=False)]
    models, odometry = {part.detector.file: part.model}, {}
    for checkpoint in checkpoints:
        record = _head_record(checkpoint, part)
        odometry[checkpoint.kind] = record
        models[record.file] = head_to_onnx(checkpoint.head, record)
    seal(part.model, part.detector)
    manifest = Manifest(
        format=FORMAT,
        name=part.name,
        version=version("edgemap"),
        detector=part.detector,
        sha256={},
        odometry=odometry,
        envelope={key: value for checkpoint in checkpoints for key, value in checkpoint.envelope.items()},
        measured=part.measured | {f"odometry.{item.kind}": item.measured for item in checkpoints if item.measured},
        licence=part.licence,
        sources=part.sources,
    )
    trunks = {checkpoint.kind: checkpoint.head for checkpoint in checkpoints}
    return write_bundle(out, manifest, models, lambda bundle: parity.prove(bundle, part.reference, trunks, part.exact))


def _darknet(
    backbone: str,
    weights: Path | None,
    wanted: list[str],
    size: tuple[int, int] | None,
    random_seed: int | None,
    sources: tuple[str, ...],
) -> Backbone:
    network, name = _darknet_network(backbone, size)
    if random_seed is not None:
        random_weights(network, random_seed)
        about: dict[str, Any] = {"random_seed": random_seed}
        name, sources = f"{name}-random", ("random weights",)
    else:
        if weights is None:
            if name not in KNOWN or backbone not in DARKNET:
                raise ExportError(f"{backbone}: --weights FILE is needed")
            weights, sources = obtain(KNOWN[name])
        header = load_weights(network, weights)
        about = {"file": weights.name, "sha256": sha256_file(weights), "pictures_seen": header.seen}
    about["float32_values"] = value_count(network)
    detector, features = _darknet_detector(network, wanted)
    names = list(dict.fromkeys(spec.name for spec in (*detector.heads, *detector.features)))
    network.eval()

    def reference(picture: NDArray[np.float32]) -> Tensors:
        with torch.no_grad():
            tensors = network(torch.from_numpy(picture) / 255.0)
        return {name: tensor.numpy() for name, tensor in zip(names, tensors, strict=True)}

    known = KNOWN.get(backbone)
    return Backbone(
        name=name,
        model=backbone_to_onnx(network, detector),
        detector=detector,
        features=features,
        reference=reference,
        exact=False,
        measured={"weights": about},
        licence=known.licence if known else "not stated",
        sources=sources or (f"{about['file']} sha256 {about['sha256']}",),
    )


def _darknet_network(backbone: str, size: tuple[int, int] | None) -> tuple[Darknet, str]:
    if backbone in DARKNET:
        network = Darknet.from_cfg(DARKNET[backbone](), size)
        network.name = backbone
        return network, backbone
    path = Path(backbone)
    if path.suffix != ".cfg" and not path.is_file():
        raise ExportError(f"backbone {backbone!r} is not one of {', '.join(BACKBONES)}, nor a .cfg or .onnx file")
    return Darknet.from_cfg(path, size), path.stem


def _darknet_detector(network: Darknet, wanted: list[str]) -> tuple[Detector, dict[str, str]]:
    """The contract of a Darknet network; sets the network's outputs to heads, then features."""
    names = {head.layer: f"head_stride{network.stride(head.layer)}" for head in network.heads}
    if len(set(names.values())) != len(names):
        names = {layer: f"{name}_layer{layer}" for layer, name in names.items()}
    layers = {word: network.feature_layer(word) for word in wanted}
    for layer in layers.values():
        names.setdefault(layer, f"feature_layer{layer}")
    network.outputs = tuple(names)
    heads = tuple(
        HeadSpec(
            name=names[head.layer],
            shape=(1, *head.shape),
            strides=(network.stride(head.layer),),
            anchors=head.anchors,
            scale_xy=head.scale_xy,
        )
        for head in network.heads
    )
    features = tuple(
        FeatureSpec(name=names[layer], shape=(1, *network.shapes[layer]), stride=network.stride(layer))
        for layer in dict.fromkeys(layers.values())
    )
    detector = Detector(
        file="backbone.onnx",
        input=InputSpec(
            name="image",
            width=network.width,
            height=network.height,
            resize="letterbox",
            colour="rgb",
            scale=1.0,
            pad=DARKNET_PAD,
        ),
        decode="yolov3",
        heads=heads,
        features=features,
        classes=class_entries(network.heads[0].classes),
    )
    return detector, {word: names[layer] for word, layer in layers.items()}


def _adopted(backbone: str, weights: Path | None, wanted: list[str], sources: tuple[str, ...]) -> Backbone:
    known = KNOWN.get(backbone)
    path, name = (Path(backbone), Path(backbone).stem) if known is None else (weights, backbone)
    if path is None:
        assert known is not None
        path, sources = obtain(known)
    if len(set(wanted)) != 1:
        raise ExportError(f"{path}: heads that read different features ({', '.join(wanted)}) do not fit one ONNX file")
    model, detector = adopt(path, wanted[0])
    original = parity.open_network(path)

    def reference(picture: NDArray[np.float32]) -> Tensors:
        return original.run({detector.input.name: picture})

    return Backbone(
        name=name,
        model=model,
        detector=detector,
        features={wanted[0]: detector.features[0].name},
        reference=reference,
        exact=True,
        measured={"weights": {"file": path.name, "sha256": sha256_file(path)}},
        licence=known.licence if known else "not stated",
        sources=sources or (f"{path.name} sha256 {sha256_file(path)}",),
    )


def _head_record(checkpoint: HeadCheckpoint, part: Backbone) -> OdometryHead:
    name = part.features[checkpoint.feature]
    shape, head = _feature_shape(part.detector, name), checkpoint.head
    if head.shape != shape:
        raise ExportError(f"{checkpoint.kind} head takes features {head.shape}, {name} of {part.name} has {shape}")
    words = [f"{word}{layer + 1}" for layer in range(len(head.hidden)) for word in ("hidden", "cell")]
    states = tuple(
        StateSpec(input=f"{word}_in", output=f"{word}_out", shape=shape)
        for word, shape in zip(words, head.state_shapes, strict=True)
    )
    forward, left, yaw = checkpoint.sigma
    return OdometryHead(
        file=f"odometry.{checkpoint.kind}.onnx",
        kind=checkpoint.kind,
        feature=name,
        feature_input="feature",
        motion="motion",
        states=states,
        parameters=head.parameters_count,
        trained=checkpoint.trained,
        sigma_forward_m=forward,
        sigma_left_m=left,
        sigma_yaw_rad=yaw,
    )


def _feature_shape(detector: Detector, name: str) -> tuple[int, ...]:
    return next(spec.shape for spec in detector.features if spec.name == name)
