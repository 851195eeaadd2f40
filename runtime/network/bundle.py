"""Loads a bundle: every file's sum, contract and graph are checked before a network runs."""

from collections.abc import Callable, Collection
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import msgspec
from threadpoolctl import threadpool_limits

from edgemap.geometry.observations.sighting import BoxEvidence
from edgemap.runtime.frames.errors import BundleError, OdometryError
from edgemap.runtime.frames.inference import Precision
from edgemap.runtime.network.engines import open_network
from edgemap.runtime.network.manifest import METADATA_KEY, DetectorSpec, Manifest, OdometryHead, contract_metadata
from edgemap.runtime.network.manifest_file import read_manifest, verified_file
from edgemap.runtime.network.network import Compute, Network, Shapes
from edgemap.runtime.network.preprocess import rows_of

ENGINE_TOLERANCE: dict[Precision, float] = {"float32": 1e-3, "int8": 0.1}  # of `Network.error`; int8: 0.04, same AP50


@dataclass(frozen=True, slots=True)
class Bundle:
    """A bundle whose backbone is loaded. compute, precision (float32 or int8): of the backbone. reopen: opens it for an
    input of so many rows. companion: what the floor is read from where this backbone has no output for it. paced:
    whether pictures come at a camera's pace.
    """

    folder: Path
    manifest: Manifest
    backbone: Network
    compute: Compute
    reopen: Callable[[int], Network]
    precision: Precision = "float32"
    companion: "Bundle | None" = None
    paced: bool = False

    @property
    def detector(self) -> DetectorSpec:
        """The manifest's, with an input of as many rows as the backbone has."""
        whole = self.manifest.detector
        rows = self.backbone.inputs[whole.input.name][2]
        return msgspec.structs.replace(whole, input=msgspec.structs.replace(whole.input, height=rows))

    def for_pictures(self, width: int, height: int) -> "Bundle":
        """This bundle with a backbone that leaves off the rows of its input that pictures of this size do not reach.

        For 640x480 pictures in a square input that is a quarter of its work, a sixth where they lie in its middle.
        Itself where pictures reach all rows or the file is of a fixed size.
        """
        whole = self.manifest.detector
        if any(len(head.shape) != 4 for head in whole.heads):  # lists of boxes, not maps
            return self
        coarsest = max(whole.input.height // head.shape[2] for head in whole.heads)
        _, rows = rows_of(whole.input, width, height, coarsest)
        if rows == self.detector.input.height:
            return self
        cut = self.reopen(rows)
        return replace(self, backbone=cut) if cut.inputs[whole.input.name][2] == rows else self

    @property
    def names(self) -> tuple[str, ...]:
        """Class names by class id."""
        return tuple(entry.name for entry in self.manifest.detector.classes)

    def evidence(self, mapped: Collection[str] | None, confidence: float | None) -> BoxEvidence:
        """Which boxes are evidence of an object. mapped: labels, the bundle's where None. confidence: the user's
        minimum score; below the bundle's it lowers the scores of full weight as much, so that the boxes asked for
        count."""
        lowered = 0.0 if confidence is None else min(0.0, confidence - self.manifest.confidence)
        scores = {label: score + lowered for label, score in self.manifest.class_scores.items()}
        return BoxEvidence(self.mapped if mapped is None else mapped, self.manifest.sure_confidence + lowered, scores)

    @property
    def mapped(self) -> frozenset[str]:
        """Names of the classes that may appear on the map."""
        return frozenset(entry.name for entry in self.manifest.detector.classes if entry.mapped)

    def odometry_head(self, kind: str) -> tuple[OdometryHead, Network]:
        """Load the bundle's learned odometry of a kind. Raises OdometryError where the bundle has none.

        It runs in onnxruntime: OpenVINO takes as long for its many small operators; on one thread: those of two
        networks would delay each other.
        """
        head = self.manifest.odometry.get(kind)
        if head is None:
            raise OdometryError(f"bundle {self.manifest.name} has no {kind} odometry; edgemap-nano has one")
        feature = self.manifest.detector.outputs().get(head.feature)
        if feature is None:
            raise BundleError(f"bundle {self.folder}: {head.file} reads {head.feature!r}, which no output provides")
        inputs = {head.feature_input: feature} | {state.input: state.shape for state in head.states}
        outputs = {head.motion: (1, 3)} | {state.output: state.shape for state in head.states}
        return head, _opened(self.folder, self.manifest, head, inputs, outputs, Compute(1))


def load_bundle(folder: Path, compute: Compute = Compute(), precision: Precision = "float32") -> Bundle:  # noqa: B008
    """Check and load a bundle folder. Raises BundleError, one line that names the file and the error.

    compute: of the backbone; outputs of another engine than onnxruntime must agree with its. BLAS gets one thread.
    precision: int8 where the bundle has that variant.
    """
    threadpool_limits(1, "blas")  # numpy's and scipy's in this process: the matrices of a step are small
    manifest = read_manifest(folder)
    detector = manifest.detector
    if precision != "float32":
        if precision not in manifest.variants:
            raise BundleError(f"bundle {manifest.name} has no {precision} variant (edgemap export --int8 makes one)")
        detector = msgspec.structs.replace(detector, file=manifest.variants[precision].file)
    height = detector.input.height
    inputs = {detector.input.name: (1, 3, height, detector.input.width)}
    backbone = _opened(folder, manifest, detector, inputs, detector.outputs(), compute, height)
    reopen = partial(open_network, folder / detector.file, compute)
    return Bundle(folder, manifest, backbone, compute, reopen, precision)


def _opened(
    folder: Path,
    manifest: Manifest,
    record: DetectorSpec | OdometryHead,
    inputs: Shapes,
    outputs: Shapes,
    compute: Compute,
    rows: int | None = None,
) -> Network:
    """A network whose sum, contract and tensors are checked, and its outputs where onnxruntime does not run it."""
    path = verified_file(folder, manifest, record.file)
    where = f"bundle {folder}: {record.file}"
    network = open_network(path, compute, rows)
    reference = network if compute.engine == "onnxruntime" else open_network(path, Compute(), rows)
    contract = reference.metadata.get(METADATA_KEY)
    if contract is None:
        raise BundleError(f"{where} carries no {METADATA_KEY} metadata: not made by edgemap export")
    if contract != contract_metadata(record):
        raise BundleError(f"{where}: the contract in its metadata differs from {folder.name}/bundle.json")
    for kind, promised, actual in (("input", inputs, network.inputs), ("output", outputs, network.outputs)):
        if missing := sorted(set(promised) - set(actual)):
            raise BundleError(f"{where}: {kind} {', '.join(missing)} is missing")
        if extra := sorted(set(actual) - set(promised)):
            raise BundleError(f"{where}: {kind} {', '.join(extra)} is not in the manifest")
        for name, shape in promised.items():
            if actual[name] != shape:
                raise BundleError(f"{where}: {kind} {name} has shape {actual[name]}, manifest says {shape}")
    rounded: Precision = "float32" if record.file == manifest.detector.file else "int8"
    if network is not reference and network.error(reference) > ENGINE_TOLERANCE[rounded]:
        raise BundleError(f"{where}: {compute.engine} gives other outputs than onnxruntime")
    return network
