"""Backbones ready to be bundled: a Darknet network or an adopted ONNX file, its contract and its reference."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from onnx import ModelProto

from edgemap import __version__
from edgemap.export import parity
from edgemap.export.adopt import adopt, class_entries, load_onnx, only_outputs, static_tensors, tapped
from edgemap.export.darknet import Darknet
from edgemap.export.darknet_cfg import yolov3, yolov3_tiny
from edgemap.export.darknet_weights import load_weights, random_weights, value_count
from edgemap.export.detector.graph import Graph
from edgemap.export.detector.network import load_detector
from edgemap.export.errors import ExportError
from edgemap.export.obtain import obtain
from edgemap.export.onnx_export import backbone_to_onnx
from edgemap.export.sources import KNOWN, KnownModel
from edgemap.export.torch_files import parameter_count
from edgemap.runtime.network.engines import open_network
from edgemap.runtime.network.manifest import DetectorSpec, FeatureSpec, HeadSpec, InputSpec, Manifest
from edgemap.runtime.network.manifest_file import FORMAT, sha256_file
from edgemap.runtime.network.network import Compute, Tensors

DARKNET = {"yolov3": yolov3, "yolov3-tiny": yolov3_tiny}
ADOPTED = ("yolox-nano", "picodet-s")
BACKBONES = (*DARKNET, *ADOPTED)
NOT_KNOWN = KnownModel("", "", (), "not stated")
DARKNET_PAD = 127  # Darknet's letterbox fills with 0.5


@dataclass
class Backbone:
    """A detector ready to be bundled, with one feature of its own at most. manifest: of its bundle, before files and
    heads are added. reference: what the model must compute; exact: bit for bit.
    """

    model: ModelProto
    manifest: Manifest
    reference: parity.Reference
    exact: bool = False


def _manifest(
    name: str, detector: DetectorSpec, like: Manifest | KnownModel, measured: dict[str, Any], sources: tuple[str, ...]
) -> Manifest:
    """Of a backbone alone. like: has its licence and its scores."""
    return Manifest(
        format=FORMAT,
        name=name,
        version=__version__,
        detector=detector,
        sha256={},
        confidence=like.confidence,
        sure_confidence=like.sure_confidence,
        measured=measured,
        licence=like.licence,
        sources=sources,
    )


def darknet_backbone(
    backbone: str,
    weights: Path | None,
    feature: str | None,
    size: tuple[int, int] | None,
    random_seed: int | None,
    sources: tuple[str, ...],
) -> Backbone:
    """A Darknet network by name or .cfg, with weights from a file, a seed, or (for a name) the known sources.

    feature: what a head reads. Raises ExportError or DownloadError.
    """
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
        seen = load_weights(network, weights)
        about = {"file": weights.name, "sha256": sha256_file(weights), "pictures_seen": seen}
    about["float32_values"] = value_count(network)
    detector = _darknet_detector(network, feature)
    sources = sources or (f"{about['file']} sha256 {about['sha256']}",)
    manifest = _manifest(name, detector, KNOWN.get(backbone, NOT_KNOWN), {"weights": about}, sources)
    reference = _in_torch(network, list(detector.outputs()), 255.0)
    return Backbone(backbone_to_onnx(network, detector), manifest, reference)


def trained_backbone(name: str, feature: str | None) -> Backbone:
    """A detector's best.pt, or our own bundle by name, with a feature tapped. Raises ExportError or BundleError."""
    model, start = load_detector(name)
    detector = tapped(model, start.detector, Path(name), feature)
    graph = Graph(model)
    measured = start.measured | {"weights": {"parameters": parameter_count(graph)}}
    manifest = _manifest(start.name, detector, start, measured, start.sources)
    return Backbone(model, manifest, _in_torch(graph, graph.outputs))


def _in_torch(network: torch.nn.Module, names: Sequence[str], divisor: float = 1.0) -> parity.Reference:
    """A torch network's outputs by name, of pictures over `divisor`."""
    network.eval()

    def reference(picture: NDArray[np.float32]) -> Tensors:
        with torch.no_grad():
            tensors = network(torch.from_numpy(picture) / divisor)
        return {name: tensor.numpy() for name, tensor in zip(names, tensors, strict=True)}

    return reference


def _darknet_network(backbone: str, size: tuple[int, int] | None) -> tuple[Darknet, str]:
    if backbone in DARKNET:
        network = Darknet(DARKNET[backbone](), size)
        network.name = backbone
        return network, backbone
    path = Path(backbone)
    if path.suffix != ".cfg" and not path.is_file():
        raise ExportError(f"backbone {backbone!r} is not one of {', '.join(BACKBONES)}, nor a .cfg or .onnx file")
    return Darknet(path, size), path.stem


def _darknet_detector(network: Darknet, feature: str | None) -> DetectorSpec:
    """The contract of a Darknet network; sets the network's outputs to heads, then the feature."""
    names = {head.layer: f"head_stride{network.stride(head.layer)}" for head in network.heads}
    if len(set(names.values())) != len(names):
        names = {layer: f"{name}_layer{layer}" for layer, name in names.items()}
    features: tuple[FeatureSpec, ...] = ()
    if feature is not None:
        layer = network.feature_layer(feature)
        name = names.setdefault(layer, f"feature_layer{layer}")
        features = (FeatureSpec(name=name, shape=(1, *network.shapes[layer]), stride=network.stride(layer)),)
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
    return DetectorSpec(
        file="backbone.onnx",
        input=InputSpec(
            name="image",
            width=network.width,
            height=network.height,
            resize="letterbox" if network.letterbox else "stretch",
            colour="rgb",
            scale=1.0,
            pad=DARKNET_PAD,
        ),
        decode="yolov3",
        heads=heads,
        features=features,
        classes=class_entries(network.heads[0].classes),
    )


def adopted_backbone(backbone: str, weights: Path | None, feature: str | None, sources: tuple[str, ...]) -> Backbone:
    """An ONNX detector by name or file, with a feature tapped. Raises ExportError or DownloadError."""
    entry = KNOWN.get(backbone, NOT_KNOWN)
    path, name = (Path(backbone), Path(backbone).stem) if entry is NOT_KNOWN else (weights, backbone)
    if path is None:
        path, sources = obtain(entry)
    model, detector = adopt(path, feature)
    exact = detector.decode != "dfl"
    source: Path | bytes = path
    if not exact:
        tensors = static_tensors(whole := load_onnx(path))
        source = only_outputs(whole, [tensors[head.name] for head in detector.heads]).SerializeToString()
    original = open_network(source, Compute(2, spin=True))
    about = {"file": path.name, "sha256": sha256_file(path)}
    sources = sources or (f"{about['file']} sha256 {about['sha256']}",)
    manifest = _manifest(name, detector, entry, {"weights": about}, sources)
    return Backbone(model, manifest, lambda picture: original.run({detector.input.name: picture}), exact)
