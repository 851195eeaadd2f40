"""A trained detector's `best.pt`: its ONNX graph, and the manifest that a bundle of it gets."""

from pathlib import Path

import msgspec
import onnx
import torch
from onnx import ModelProto

from edgemap.export.adopt import load_onnx
from edgemap.export.errors import ExportError
from edgemap.export.floor.merge import without_floor
from edgemap.export.onnx_export import seal
from edgemap.export.torch_files import read_torch, save_whole
from edgemap.runtime.frames.errors import BundleError
from edgemap.runtime.frames.reading import decode_json, one_line
from edgemap.runtime.network.manifest import Manifest, check_shapes, read_manifest, verified_file
from edgemap.runtime.network.store import bundle_folder

FORMAT = "edgemap.detector/2"


def save_detector(model: ModelProto, manifest: Manifest, path: Path) -> None:
    """Write the graph with the facts that its bundle will hold."""
    graph = bytearray(seal(model, manifest.detector).SerializeToString(deterministic=True))
    document = {
        "format": FORMAT,
        "manifest": msgspec.json.encode(manifest).decode(),
        "graph": torch.frombuffer(graph, dtype=torch.uint8),
    }
    save_whole(document, path)


def load_detector(name: str) -> tuple[ModelProto, Manifest]:
    """The graph and manifest of a `best.pt`, or of a bundle, by name or folder; rows that it leaves open are closed.

    A floor head is left out: it belongs to a detector as it is, and export joins it again.
    Raises ExportError or BundleError.
    """
    if name.endswith(".pt"):
        model, manifest = _read(Path(name))
    else:
        folder = bundle_folder(name)
        manifest = read_manifest(folder)
        model = load_onnx(verified_file(folder, manifest, manifest.detector.file))
    shapes = manifest.detector.outputs()
    shapes[manifest.detector.input.name] = (1, 3, manifest.detector.input.height, manifest.detector.input.width)
    for value in (*model.graph.input, *model.graph.output):
        for axis, size in zip(value.type.tensor_type.shape.dim, shapes.get(value.name, ()), strict=False):
            axis.dim_value = size
    model, detector = without_floor(model, manifest.detector)
    return model, msgspec.structs.replace(manifest, detector=detector)


def is_detector(path: Path) -> bool:
    """Whether a torch file is a detector's checkpoint, and not an odometry head's. Raises ExportError."""
    return str(read_torch(path).get("format")).startswith("edgemap.detector/")


def _read(path: Path) -> tuple[ModelProto, Manifest]:
    document = read_torch(path)
    text, graph = document.get("manifest"), document.get("graph")
    if document.get("format") != FORMAT or not isinstance(text, str) or not isinstance(graph, torch.Tensor):
        raise ExportError(f"{path}: no detector that this version trained ({FORMAT})")
    manifest = decode_json(text.encode(), Manifest, f"{path}: manifest", ExportError)
    try:
        check_shapes(path, manifest)
        model = onnx.load_from_string(graph.numpy().tobytes())
        onnx.checker.check_model(model, full_check=True)
    except BundleError as error:
        raise ExportError(str(error)) from None
    except Exception as error:  # onnx and torch raise whatever they like at files that are none
        raise ExportError(f"{path}: its graph does not read ({one_line(error, 160)})") from None
    return model, manifest
