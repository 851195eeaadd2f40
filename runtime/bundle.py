"""Loads a bundle: every file's sum, contract and graph are checked before a network runs."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

import msgspec
import numpy as np
import onnxruntime as ort
from numpy.typing import NDArray

from edgemap.runtime.errors import BundleError, OdometryError
from edgemap.runtime.manifest import (
    METADATA_KEY,
    OPSETS,
    Detector,
    Manifest,
    OdometryHead,
    contract_metadata,
    read_manifest,
    verified_file,
)
from edgemap.runtime.precision import WORTH_IT, Precision, report_allows_int8, time_ratio

Tensors = dict[str, NDArray[np.float32]]

HEAD_THREADS = 1


class Network:
    """One ONNX file of a bundle, ready to run. inputs, outputs: name to shape, all static."""

    def __init__(self, session: ort.InferenceSession) -> None:
        self._session = session
        self.inputs = {node.name: tuple(node.shape) for node in session.get_inputs()}
        self.outputs = {node.name: tuple(node.shape) for node in session.get_outputs()}
        self._names = list(self.outputs)

    def run(self, tensors: Tensors) -> Tensors:
        """Run once: float32 inputs by name to float32 outputs by name."""
        values: list[Any] = list(self._session.run(self._names, tensors))
        return dict(zip(self._names, values, strict=True))


@dataclass(frozen=True, slots=True)
class Bundle:
    """A bundle whose backbone is loaded. threads: of each network. precision: of the backbone, float32 or int8."""

    folder: Path
    manifest: Manifest
    backbone: Network
    threads: int
    precision: Precision = "float32"

    @property
    def names(self) -> tuple[str, ...]:
        """Class names by class id."""
        return tuple(entry.name for entry in self.manifest.detector.classes)

    def full_weight_score(self, confidence: float | None) -> float:
        """Score of a box that counts half towards making an object. confidence: what the user asks of every box."""
        return self.manifest.sure_confidence if confidence is None else 0.0

    @property
    def mapped(self) -> frozenset[str]:
        """Names of the classes that may appear on the map."""
        return frozenset(entry.name for entry in self.manifest.detector.classes if entry.mapped)

    def odometry_head(self, kind: str) -> tuple[OdometryHead, Network]:
        """Load the bundle's learned odometry of a kind. Raises OdometryError where the bundle has none.

        It runs on one thread: the idle threads of two networks spin in each other's way. Measured on two cores,
        backbone and flow head in turn take 8.4 + 7.6 ms with two threads each, 4.0 + 4.9 ms so.
        """
        head = self.manifest.odometry.get(kind)
        if head is None:
            has = ", ".join(sorted(self.manifest.odometry)) or "none"
            raise OdometryError(f"bundle {self.manifest.name} has no {kind} odometry (it has: {has})")
        inputs = {head.feature_input: self._feature_shape(head)} | {state.input: state.shape for state in head.states}
        outputs = {head.motion: (1, 3)} | {state.output: state.shape for state in head.states}
        if head.geometry is not None:
            inputs |= {head.geometry.cells: head.geometry.shape, head.geometry.mount: (1, 12), head.geometry.dt: (1, 1)}
            outputs |= {head.geometry.covariance: (1, 3, 3)}
        return head, _open(self.folder, self.manifest, head, inputs, outputs, HEAD_THREADS)

    def _feature_shape(self, head: OdometryHead) -> tuple[int, ...]:
        for feature in self.manifest.detector.features:
            if feature.name == head.feature:
                return feature.shape
        raise BundleError(f"bundle {self.folder}: {head.file} reads feature {head.feature!r}, which no output provides")


def load_bundle(folder: Path, threads: int = 2, precision: Precision = "float32") -> Bundle:
    """Check and load a bundle folder. Raises BundleError, one line that names the file and what is wrong with it.

    precision: float32; int8, where the bundle has that variant; auto: int8 where its report allows it and a trial of
    about a second finds it faster on this processor, else float32.
    """
    if precision == "auto":
        return _load_the_faster(folder, threads)
    manifest = read_manifest(folder)
    detector = manifest.detector
    if precision != "float32":
        if precision not in manifest.variants:
            raise BundleError(f"bundle {manifest.name} has no {precision} variant (edgemap export --int8 makes one)")
        detector = msgspec.structs.replace(detector, file=manifest.variants[precision].file)
    inputs = {detector.input.name: _input_shape(detector)}
    outputs = {head.name: head.shape for head in detector.heads}
    outputs |= {feature.name: feature.shape for feature in detector.features}
    network = _open(folder, manifest, detector, inputs, outputs, threads)
    return Bundle(folder, manifest, network, threads, precision)


def _load_the_faster(folder: Path, threads: int) -> Bundle:
    exact = load_bundle(folder, threads)
    if not report_allows_int8(exact.manifest):
        return exact
    small = load_bundle(folder, threads, "int8")
    spec = exact.manifest.detector
    picture = np.random.default_rng(0).integers(0, 256, _input_shape(spec)).astype(np.float32)
    tensors = {spec.input.name: picture * np.float32(spec.input.scale)}
    ratio = time_ratio(lambda: small.backbone.run(tensors), lambda: exact.backbone.run(tensors))
    return small if ratio <= WORTH_IT else exact


def _input_shape(detector: Detector) -> tuple[int, ...]:
    return (1, 3, detector.input.height, detector.input.width)


def _open(
    folder: Path,
    manifest: Manifest,
    record: Detector | OdometryHead,
    inputs: dict[str, tuple[int, ...]],
    outputs: dict[str, tuple[int, ...]],
    threads: int,
) -> Network:
    path = verified_file(folder, manifest, record.file)
    where = f"bundle {folder}: {record.file}"
    _check_opset(path, where)
    try:
        session = ort.InferenceSession(str(path), session_options(threads), providers=["CPUExecutionProvider"])
    except Exception as error:  # onnxruntime's exceptions share no public base
        raise BundleError(f"{where} is not a model that onnxruntime loads ({_first_line(error)})") from None
    contract = session.get_modelmeta().custom_metadata_map.get(METADATA_KEY)
    if contract is None:
        raise BundleError(f"{where} carries no {METADATA_KEY} metadata: not made by edgemap export")
    if contract != contract_metadata(record):
        raise BundleError(f"{where}: the contract in its metadata differs from {folder.name}/bundle.json")
    network = Network(session)
    _compare(where, "input", inputs, network.inputs)
    _compare(where, "output", outputs, network.outputs)
    return network


def _compare(where: str, kind: str, promised: dict[str, tuple[int, ...]], found: dict[str, tuple[int, ...]]) -> None:
    if missing := sorted(set(promised) - set(found)):
        raise BundleError(f"{where}: {kind} {', '.join(missing)} is missing")
    if extra := sorted(set(found) - set(promised)):
        raise BundleError(f"{where}: {kind} {', '.join(extra)} is not in the manifest")
    for name, shape in promised.items():
        if found[name] != shape:
            raise BundleError(f"{where}: {kind} {name} has shape {found[name]}, manifest says {shape}")


def session_options(threads: int) -> ort.SessionOptions:
    """How every network here runs: `threads` compute threads, one operator at a time, quiet.

    Idle threads spin (onnxruntime's default): measured on two cores with a step's other work between runs, YOLOX-Nano
    takes 5.0 ms spinning and 6.7 ms not, YOLOv3-tiny 13 ms either way.
    """
    options = ort.SessionOptions()
    options.intra_op_num_threads = threads
    options.inter_op_num_threads = 1
    options.log_severity_level = 4
    return options


def default_threads() -> int:
    """Two, or one where the machine has only one core to give."""
    return max(1, min(2, len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1))


def _check_opset(path: Path, where: str) -> None:
    opset = onnx_opset(path)
    if opset is None:
        raise BundleError(f"{where} is not a complete ONNX file ({path.stat().st_size} bytes, no opset found)")
    if opset not in OPSETS:
        raise BundleError(f"{where} uses ONNX opset {opset}, this edgemap runs {OPSETS[0]} to {OPSETS[-1]}")


def onnx_opset(path: Path) -> int | None:
    """Version of the default operator set that an ONNX file imports; None where the file is cut or is no ONNX file.

    Walks the top level of the protobuf (onnx.proto: ModelProto field 8, OperatorSetIdProto fields 1 and 2) without
    reading the graph, so that the robot needs no onnx package.
    """
    size, found = path.stat().st_size, None
    with path.open("rb") as stream:
        while stream.tell() < size:
            key = _varint(stream)
            if key is None or key & 7 not in (0, 2) or key == 0:
                return None
            value = _varint(stream)
            if value is None:
                return None
            if key & 7 == 2:
                end = stream.tell() + value
                if end > size:
                    return None
                if key >> 3 == 8:
                    found = _opset_version(stream, end) or found
                stream.seek(end)
    return found


def _opset_version(stream: BinaryIO, end: int) -> int | None:
    domain, version = b"", None
    while stream.tell() < end:
        key, value = _varint(stream), _varint(stream)
        if key is None or value is None:
            return None
        if key >> 3 == 1:
            domain = stream.read(value)
        elif key >> 3 == 2:
            version = value
    return version if domain in (b"", b"ai.onnx") else None


def _varint(stream: BinaryIO) -> int | None:
    value, shift = 0, 0
    while byte := stream.read(1):
        value |= (byte[0] & 0x7F) << shift
        if byte[0] < 0x80:
            return value
        shift += 7
        if shift > 63:
            return None
    return None


def _first_line(error: Exception) -> str:
    return str(error).strip().splitlines()[0][:160] if str(error).strip() else type(error).__name__
