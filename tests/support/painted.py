"""Bundles whose detector sees what a test paints: real ONNX files for onnxruntime, outputs fixed in advance."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Literal

import msgspec
import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

from edgemap.geometry.camera.floor import FloorCamera
from edgemap.geometry.camera.intrinsics import Intrinsics
from edgemap.geometry.camera.mount import Mount
from edgemap.geometry.paper.paper_map import PaperMap
from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.trajectory import Trajectory
from edgemap.runtime.motion.odometry.recorded import RecordedOdometry
from edgemap.runtime.network.bundle import Bundle
from edgemap.runtime.network.manifest import (
    METADATA_KEY,
    BundleVariant,
    ClassEntry,
    DetectorSpec,
    FeatureSpec,
    FloorSpec,
    HeadSpec,
    InputSpec,
    Manifest,
    OdometryHead,
    StateSpec,
    contract_metadata,
)
from edgemap.runtime.network.manifest_file import FORMAT, read_manifest, sha256_file, write_manifest
from edgemap.runtime.step.mapper import Mapper
from edgemap.runtime.step.pipeline import Pipeline
from edgemap.runtime.step.slam import SemanticSlam

Resize = Literal["stretch", "letterbox", "letterbox_topleft"]

SIZE, STRIDE, ANCHOR = 64, 32, (20.0, 30.0)
NAMES = ("chair", "person", "couch")
FLOOR = FloorCamera(Intrinsics(SIZE, SIZE, 50.0, 50.0, 31.5, 31.5), Mount(1.0))


def logit(p: float) -> float:
    return float(np.log(p / (1 - p)))


def head_with(boxes: list[tuple[str, float, float, float, float, float]], cells: int = SIZE // STRIDE) -> np.ndarray:
    """A YOLOv3 head (1, 8, cells, cells) that decodes to the boxes: (label, centre x, y, w, h in input px, score)."""
    head, stride = np.full((1, 5 + len(NAMES), cells, cells), -12.0, dtype=np.float32), SIZE // cells
    for label, x, y, w, h, score in boxes:
        column, row = int(x // stride), int(y // stride)
        head[0, 0, row, column] = logit(min(max(x / stride - column, 1e-6), 1 - 1e-6))
        head[0, 1, row, column] = logit(min(max(y / stride - row, 1e-6), 1 - 1e-6))
        head[0, 2, row, column], head[0, 3, row, column] = np.log(w / ANCHOR[0]), np.log(h / ANCHOR[1])
        head[0, 4, row, column] = 12.0
        head[0, 5 + NAMES.index(label), row, column] = logit(score)
    return head


def detector_spec(file: str = "backbone.onnx", resize: Resize = "stretch", cells: int = SIZE // STRIDE) -> DetectorSpec:
    shape, stride = (1, 5 + len(NAMES), cells, cells), SIZE // cells
    return DetectorSpec(
        file=file,
        input=InputSpec(name="image", width=SIZE, height=SIZE, resize=resize, colour="rgb", scale=1 / 255, pad=127),
        decode="yolov3",
        heads=(HeadSpec(name="head", shape=shape, strides=(stride,), anchors=(ANCHOR,)),),
        features=(FeatureSpec(name="head", shape=shape, stride=stride),),
        classes=tuple(ClassEntry(name=name, mapped=name != "person") for name in NAMES),
    )


def backbone_model(head: np.ndarray, opset: int = 17, outputs: tuple[str, ...] = ("head",)) -> onnx.ModelProto:
    """head + 0 * mean(image), under each of the output names."""
    nodes = [
        helper.make_node("GlobalAveragePool", ["image"], ["pooled"]),
        helper.make_node("ReduceMax", ["pooled"], ["mean"], keepdims=0),
        helper.make_node("Mul", ["mean", "zero"], ["nothing"]),
    ]
    nodes += [helper.make_node("Add", ["painted", "nothing"], [name]) for name in outputs]
    graph = helper.make_graph(
        nodes, "painted", [helper.make_tensor_value_info("image", TensorProto.FLOAT, (1, 3, SIZE, SIZE))],
        [helper.make_tensor_value_info(name, TensorProto.FLOAT, head.shape) for name in outputs],
        [numpy_helper.from_array(head, "painted"), numpy_helper.from_array(np.zeros((), np.float32), "zero")],
    )  # fmt: skip
    return helper.make_model(graph, opset_imports=[helper.make_opsetid("", opset)], ir_version=8)


def odometry_spec(trained: bool, window: int = 0) -> OdometryHead:
    return OdometryHead(
        file="odometry.paper.onnx", kind="paper", feature="head", feature_input="feature", motion="motion",
        states=(StateSpec(input="count_in", output="count_out", shape=(1, 1)),), parameters=0, trained=trained,
        window=window,
    )  # fmt: skip


def odometry_model(feature_shape: tuple[int, ...]) -> onnx.ModelProto:
    """motion = (0.01 * (steps before), 0, 0): what comes out shows that the state was carried."""
    nodes = [
        helper.make_node("GlobalAveragePool", ["feature"], ["pooled"]),
        helper.make_node("ReduceMax", ["pooled"], ["mean"], keepdims=0),
        helper.make_node("Mul", ["mean", "zero"], ["nothing"]),
        helper.make_node("Add", ["count_in", "one"], ["added"]),
        helper.make_node("Add", ["added", "nothing"], ["count_out"]),
        helper.make_node("Mul", ["count_in", "scale"], ["motion"]),
    ]

    def value(name: str, shape: tuple[int, ...]) -> onnx.ValueInfoProto:
        return helper.make_tensor_value_info(name, TensorProto.FLOAT, shape)

    weights = {"zero": np.zeros(()), "one": np.ones(()), "scale": np.array([[0.01, 0, 0]])}
    constants = [numpy_helper.from_array(np.asarray(array, np.float32), name) for name, array in weights.items()]
    given, made = [value("feature", feature_shape), value("count_in", (1, 1))], [value("motion", (1, 3))]
    graph = helper.make_graph(nodes, "counter", given, [*made, value("count_out", (1, 1))], constants)
    return helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)


def write_painted(
    folder: Path,
    boxes: list[tuple[str, float, float, float, float, float]],
    *,
    opset: int = 17,
    outputs: tuple[str, ...] = ("head",),
    metadata: str | None = None,
    resize: Resize = "stretch",
    odometry: bool | None = None,
    window: int = 0,
) -> Path:
    """Write a whole bundle. odometry: None for none, else whether it says that it is trained."""
    folder.mkdir(parents=True, exist_ok=True)
    head = head_with(boxes)
    record = detector_spec(resize=resize)
    save(folder / record.file, backbone_model(head, opset, outputs), metadata or contract_metadata(record))
    heads = {}
    if odometry is not None:
        heads["paper"] = odometry_spec(odometry, window)
        save(folder / "odometry.paper.onnx", odometry_model(head.shape), contract_metadata(heads["paper"]))
    sums = {path.name: sha256_file(path) for path in folder.glob("*.onnx")}
    manifest = Manifest(format=FORMAT, name="painted", version="1", detector=record, sha256=sums, odometry=heads)
    write_manifest(folder, manifest)
    return folder


def with_int8(
    folder: Path, boxes: list[tuple[str, float, float, float, float, float]], measured: dict[str, Any]
) -> Path:
    """Give a painted bundle an "int8" variant that sees other boxes, so that one can tell which file ran."""
    manifest = read_manifest(folder)
    file = "backbone.int8.onnx"
    model, floor = backbone_model(head_with(boxes)), manifest.detector.floor
    if floor is not None:
        _add_floor(model, np.ones(floor.shape))
    save(folder / file, model, contract_metadata(manifest.detector))
    manifest.sha256[file] = sha256_file(folder / file)
    manifest.variants["int8"] = BundleVariant(file=file, measured=measured)
    write_manifest(folder, manifest)
    return folder


def with_floor(folder: Path, floor: np.ndarray, stride: int) -> Path:
    """Give a painted bundle a floor mask, (1, 1 or 2, rows, columns) of probabilities."""
    manifest = read_manifest(folder)
    labels = ("floor", "wall")[: floor.shape[1]]
    spec = FloorSpec(name="floor", shape=floor.shape, stride=stride, labels=labels)
    detector = msgspec.structs.replace(manifest.detector, floor=spec)
    model = onnx.load(folder / detector.file)
    _add_floor(model, floor)
    del model.metadata_props[:]
    save(folder / detector.file, model, contract_metadata(detector))
    write_manifest(folder, msgspec.structs.replace(manifest, detector=detector))
    resum(folder)
    return folder


def _add_floor(model: onnx.ModelProto, floor: np.ndarray) -> None:
    model.graph.initializer.append(numpy_helper.from_array(floor.astype(np.float32), "painted_floor"))
    model.graph.node.append(helper.make_node("Add", ["painted_floor", "nothing"], ["floor"]))
    model.graph.output.append(helper.make_tensor_value_info("floor", TensorProto.FLOAT, floor.shape))


def save(path: Path, model: onnx.ModelProto, contract: str) -> None:
    model.metadata_props.add(key=METADATA_KEY, value=contract)
    path.write_bytes(model.SerializeToString())


def resum(folder: Path) -> None:
    """Make the manifest's sums right again after a test has changed a file."""
    manifest = msgspec.json.decode((folder / "bundle.json").read_bytes(), type=Manifest)
    manifest.sha256 = {name: sha256_file(folder / name) for name in manifest.sha256}
    write_manifest(folder, manifest)


def slam_of(bundle: Bundle, poses: Sequence[SE2], paper: PaperMap | None = None) -> SemanticSlam:
    """The real front and back end over `FLOOR`, on recorded poses, ten a second."""
    odometry = RecordedOdometry(Trajectory(np.arange(len(poses)) / 10, tuple(poses)), "test")
    return SemanticSlam(Pipeline(bundle, FLOOR, odometry), Mapper(paper=paper))
