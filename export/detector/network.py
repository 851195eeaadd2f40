"""The detector that is trained: the graph of a bundle, its contract, and its pictures' way in."""

import copy
from pathlib import Path
from typing import Any

import msgspec
import torch
from onnx import ModelProto
from torch import Tensor, nn

from edgemap.export.detector.boxes import Rows, read_heads
from edgemap.export.detector.checkpoint import load_detector, save_detector
from edgemap.export.detector.graph import Graph
from edgemap.export.torch_files import finite
from edgemap.runtime.network.manifest import Manifest


class TorchNetwork(nn.Module):
    """BGR pictures (B, 3, H, W), 0..255, to the outputs of a bundle's heads.

    Batch normalisation is folded into the convolutions of a bundle's graph: there are no statistics, and any batch size
    works. all_layers: if false, the layers before the features that odometry heads read keep their weights, so that
    those heads still fit.
    """

    _factor: Tensor
    _offset: Tensor

    def __init__(self, model: ModelProto, manifest: Manifest, all_layers: bool = False) -> None:
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
        first = [name for feature in self.detector.features for name in self.graph.before(feature.name)]
        for name in () if all_layers else first:
            self.graph.get_parameter(name).requires_grad_(False)

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
        """Write `best.pt`. measured: figures of its training."""
        manifest = msgspec.structs.replace(self.manifest, measured=measured)
        save_detector(self.graph.model(), manifest, path)

    def copy(self) -> "TorchNetwork":
        """A copy of the network with the same weights."""
        return copy.deepcopy(self)


def load_network(name: str, all_layers: bool = False) -> TorchNetwork:
    """The network of a bundle, by name or folder, or of a `best.pt`. Raises ExportError or BundleError."""
    network = TorchNetwork(*load_detector(name), all_layers)
    finite(network, Path(name))
    return network
