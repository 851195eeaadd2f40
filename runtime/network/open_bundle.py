"""A bundle as a run uses it: one of ours or a detector of another project, with a companion for the floor."""

from collections.abc import Sequence
from dataclasses import replace
from functools import cache, partial
from pathlib import Path
from typing import Any

from google.protobuf import descriptor_pb2, message_factory

from edgemap.runtime.frames.errors import BundleError
from edgemap.runtime.frames.inference import Engine, Precision
from edgemap.runtime.network.bundle import Bundle, load_bundle
from edgemap.runtime.network.engines import Pace, compute_at, open_network
from edgemap.runtime.network.foreign import load_foreign
from edgemap.runtime.network.manifest_file import read_manifest, verified_file
from edgemap.runtime.network.network import Compute
from edgemap.runtime.network.store import bundle_folder

STRING, MESSAGE = descriptor_pb2.FieldDescriptorProto.TYPE_STRING, descriptor_pb2.FieldDescriptorProto.TYPE_MESSAGE
# Messages of onnx.proto by name: the fields that are read here, with number, type and whether they repeat. All other
# fields are kept as they are.
MESSAGES: dict[str, dict[str, tuple[int, str, bool]]] = {
    "Model": {"graph": (7, "Graph", False)},
    "Graph": {"node": (1, "Node", True), "initializer": (5, "Tensor", True), "output": (12, "Value", True)},
    "Node": {"input": (1, "", True), "output": (2, "", True)},
    "Tensor": {"name": (8, "", False)},
    "Value": {"name": (1, "", False)},
}


@cache
def _model_class() -> type[Any]:
    file = descriptor_pb2.FileDescriptorProto(name="edgemap_subgraph.proto", package="edgemap_subgraph")
    for name, fields in MESSAGES.items():
        message = file.message_type.add(name=name)
        for field, (number, kind, repeated) in fields.items():
            made = message.field.add(name=field, number=number, label=3 if repeated else 1)
            made.type = MESSAGE if kind else STRING
            if kind:
                made.type_name = f".edgemap_subgraph.{kind}"
    return message_factory.GetMessages([file])["edgemap_subgraph.Model"]


def subgraph(model: bytes, outputs: set[str]) -> bytes:
    """An ONNX model with these outputs alone, and the nodes and weights that they need."""
    tree = _model_class().FromString(model)
    keep_outputs(tree.graph, outputs)
    return tree.SerializeToString()


def keep_outputs(graph: Any, outputs: set[str]) -> None:
    """Drops the other outputs of an ONNX graph, and the nodes and weights that nothing else needs.

    Nodes with graphs of their own (If, Loop) keep what they name as inputs only.
    """
    needed, kept = set(outputs), []
    for node in reversed(graph.node):  # ONNX orders nodes so that inputs come first
        if needed.intersection(node.output):
            needed.update(node.input)
            kept.append(node)
    kept.reverse()
    weights = [one for one in graph.initializer if one.name in needed]
    ends = [one for one in graph.output if one.name in outputs]
    for field, items in (("node", kept), ("initializer", weights), ("output", ends)):
        graph.ClearField(field)
        getattr(graph, field).extend(items)


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
    usual, asked = compute_at(pace, threads), compute_at(pace, threads, engine)
    if names is not None and not foreign:
        raise BundleError(f"bundle {source}: its classes have names already; names are for a FILE.onnx")
    loaded = load_foreign(source, usual, names) if foreign else load_bundle(source, asked, precision)
    if companion is None or not beside:
        return loaded
    return replace(loaded, companion=load_companion(bundle_folder(companion), usual), paced=pace == "camera")


def load_companion(folder: Path, compute: Compute) -> Bundle:
    """A bundle whose backbone is cut down to the floor mask. Raises BundleError."""
    whole = load_bundle(folder, compute)
    detector = whole.manifest.detector
    kept = {detector.floor.name} if detector.floor else set()
    model = subgraph(verified_file(folder, whole.manifest, detector.file).read_bytes(), kept)
    reopen = partial(open_network, model, whole.compute)
    return replace(whole, backbone=reopen(detector.input.height), reopen=reopen)
