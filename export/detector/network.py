"""A detector as a torch network, and as a file: what training saves and export reads."""

import copy
from pathlib import Path
from typing import Any

import msgspec
import onnx
import torch
from onnx import ModelProto
from torch import Tensor, nn

from edgemap.export.adopt import load_onnx
from edgemap.export.detector.boxes import Rows, read_heads
from edgemap.export.detector.graph import Graph
from edgemap.export.errors import ExportError
from edgemap.export.floor.merge import without_floor
from edgemap.export.onnx_export import seal
from edgemap.export.torch_files import finite, read_torch, save_whole
from edgemap.runtime.frames.errors import BundleError
from edgemap.runtime.frames.reading import decode_json, one_line
from edgemap.runtime.network.manifest import Manifest
from edgemap.runtime.network.manifest_file import check_shapes, read_manifest, verified_file
from edgemap.runtime.network.store import bundle_folder

FORMAT = "edgemap.detector/2"


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


class TorchNetwork(nn.Module):
    """BGR pictures (B, 3, H, W), 0..255, to the outputs of a bundle's heads.

    Batch normalisation is folded into the convolutions of a bundle's graph: there are no statistics, and any batch size
    works.
    """

    _factor: Tensor
    _offset: Tensor

    def __init__(self, model: ModelProto, manifest: Manifest) -> None:
        super().__init__()
        self.manifest, self.detector = manifest, manifest.detector
        self.names = tuple(entry.name for entry in self.detector.classes)
        self.side = self.detector.input.width
        self.graph = Graph(model)
        spec = self.detector.input
        self._flip = spec.colour == "rgb"
        self.register_buffer("_factor", spec.scale / torch.tensor(spec.std)[:, None, None], persistent=False)
        offset = (torch.tensor(spec.mean) / torch.tensor(spec.std))[:, None, None]
        self.register_buffer("_offset", offset, persistent=False)
        self.to(memory_format=torch.channels_last)  # type: ignore[call-overload]

    def forward(self, image: Tensor) -> tuple[Tensor, ...]:
        """The heads' raw outputs, in the contract's order."""
        image = (image.flip(1) if self._flip else image).float()
        x = (image * self._factor - self._offset).contiguous(memory_format=torch.channels_last)
        outputs = dict(zip(self.graph.outputs, self.graph(x), strict=True))
        return tuple(outputs[head.name] for head in self.detector.heads)

    def read(self, outputs: tuple[Tensor, ...], image: Tensor) -> Rows:
        """Outputs for these pictures as scores and boxes."""
        return read_heads(outputs, self.detector, (image.shape[2], image.shape[3]))

    def save(self, path: Path, measured: dict[str, Any]) -> None:
        """Write `best.pt`: the graph with the facts that its bundle will hold. measured: figures of its training."""
        manifest = msgspec.json.encode(msgspec.structs.replace(self.manifest, measured=measured)).decode()
        graph = bytearray(seal(self.graph.model(), self.detector).SerializeToString(deterministic=True))
        save_whole({"format": FORMAT, "manifest": manifest, "graph": torch.frombuffer(graph, dtype=torch.uint8)}, path)

    def copy(self) -> "TorchNetwork":
        """A copy of the network with the same weights."""
        return copy.deepcopy(self)


def load_network(name: str) -> TorchNetwork:
    """The network of a bundle, by name or folder, or of a `best.pt`. Raises ExportError or BundleError."""
    network = TorchNetwork(*load_detector(name))
    finite(network, Path(name))
    return network
