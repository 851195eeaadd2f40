"""The bundle: what export writes and the robot loads, checked before anything runs.

A bundle is a folder with `bundle.json` (this module's `Manifest`) beside ONNX files. Sums are checked before
a file is parsed; the contract in each ONNX file's metadata must say the same as the manifest.
"""

from __future__ import annotations

import hashlib
import json
from pathlib import Path, PurePosixPath
from typing import Any, Literal

import msgspec

from edgemap.runtime.errors import BundleError

FORMAT = "edgemap.bundle/1"
MANIFEST_NAME = "bundle.json"
METADATA_KEY = "edgemap.contract"
OPSETS = range(11, 24)  # what onnxruntime 1.17 and newer run


class Strict(msgspec.Struct, kw_only=True, forbid_unknown_fields=True):
    """A manifest record: unknown or missing fields are errors."""


class ClassEntry(Strict):
    """One class of the detector. mapped: false for what is detected but never mapped: people and
    pets, what is carried or lies on tables."""

    name: str
    mapped: bool = True


class InputSpec(Strict):
    """How a picture becomes the network's input tensor, (1, 3, height, width) float32.

    resize: `stretch` (aspect lost), `letterbox` (centred) or `letterbox_topleft`. pad: the letterbox's
    grey, 0..255, before scaling. colour: channel order. scale: factor on 0..255 values, then mean and std.
    """

    name: str
    width: int
    height: int
    resize: Literal["stretch", "letterbox", "letterbox_topleft"]
    colour: Literal["rgb", "bgr"]
    scale: float
    pad: int = 114
    mean: tuple[float, float, float] = (0.0, 0.0, 0.0)
    std: tuple[float, float, float] = (1.0, 1.0, 1.0)


class HeadSpec(Strict):
    """One raw detection output of the backbone.

    yolov3: (1, A*(5+C), H, W) logits, anchors (w, h) in input pixels, scale_xy as Darknet's `scale_x_y`.
    yolox: (1, N, 5+C) for all strides in one tensor, rows ordered stride by stride; scores already sigmoid.
    dfl: (1, C+32, H, W): class logits, then 8 bins for each side of the box (left, top, right, bottom).
    """

    name: str
    shape: tuple[int, ...]
    strides: tuple[int, ...]
    anchors: tuple[tuple[float, float], ...] = ()
    scale_xy: float = 1.0


class FeatureSpec(Strict):
    """A backbone output that feeds the odometry: name, shape (1, C, H, W), stride in input pixels."""

    name: str
    shape: tuple[int, ...]
    stride: int


class StateSpec(Strict):
    """A recurrent state tensor: input name, output name, shape; starts filled with `initial`."""

    input: str
    output: str
    shape: tuple[int, ...]
    initial: float = 0.0


class Detector(Strict):
    """The backbone file and how to read it. decode: the rule that turns heads into boxes."""

    file: str
    input: InputSpec
    decode: Literal["yolov3", "yolox", "dfl"]
    heads: tuple[HeadSpec, ...]
    features: tuple[FeatureSpec, ...]
    classes: tuple[ClassEntry, ...]


class GeometrySpec(Strict):
    """Names of further tensors of an odometry that knows lens, mount and time (`geometry.flow_cells`).

    cells: input, (1, 8, rows, columns), of cells of `stride` input px. mount: input, (1, 12). dt: input, (1, 1),
    seconds since the previous frame. covariance: output, (1, 3, 3), of the motion.
    """

    cells: str
    shape: tuple[int, ...]
    stride: int
    mount: str
    dt: str
    covariance: str


class OdometryHead(Strict):
    """A stepwise learned odometry: features and states in, motion and states out.

    feature: the name of the backbone output that it reads. motion: the output's name, (1, 3) float32 holding
    forward_m, left_m, yaw_rad of the base since the previous frame. trained: false for random weights. geometry: what
    kind `flow` takes and gives besides. window: frames after which the state starts anew from the last frame, because
    it was trained on clips of so many and runs away beyond; 0 for never.
    """

    file: str
    kind: Literal["paper", "flow"]
    feature: str
    feature_input: str
    motion: str
    states: tuple[StateSpec, ...]
    parameters: int
    trained: bool
    geometry: GeometrySpec | None = None
    window: int = 0
    sigma_forward_m: float = 0.05
    sigma_left_m: float = 0.05
    sigma_yaw_rad: float = 0.05


class Parity(Strict):
    """What export proved about one file: the largest absolute difference of torch or source model and onnxruntime."""

    max_abs_difference: float
    tolerance: float
    steps: int
    cases: int


class Variant(Strict):
    """A file that may run in the detector's place: same inputs, outputs and contract, other numbers inside.

    measured: what export found beside the float32 file: pictures, differences, AP50 where there was truth, and time.
    """

    file: str
    measured: dict[str, Any] = {}


class Manifest(Strict):
    """`bundle.json`. sha256: of every other file in the folder, by its relative path.

    variants: by precision, `int8`.

    envelope: camera heights, pitches, fields of view, frame rates and speeds that a trained odometry has seen
    (empty while none is trained). confidence: least score of a box, unless told otherwise; sure_confidence: of one that
    counts half towards making an object, then. measured: figures with their data. sources: where the weights came from.
    """

    format: str
    name: str
    version: str
    detector: Detector
    sha256: dict[str, str]
    odometry: dict[str, OdometryHead] = {}
    variants: dict[Literal["int8"], Variant] = {}
    parity: dict[str, Parity] = {}
    envelope: dict[str, tuple[float, float]] = {}
    confidence: float = 0.3
    sure_confidence: float = 0.0
    measured: dict[str, Any] = {}
    licence: str = ""
    sources: tuple[str, ...] = ()


def contract_metadata(record: Detector | OdometryHead) -> str:
    """The contract as it stands in an ONNX file's metadata under `METADATA_KEY`: canonical JSON, file name left out."""
    document = msgspec.to_builtins(record)
    document.pop("file")
    for volatile in ("trained", "window", "sigma_forward_m", "sigma_left_m", "sigma_yaw_rad"):
        document.pop(volatile, None)
    return json.dumps(document, sort_keys=True, separators=(",", ":"))


def sha256_file(path: Path) -> str:
    """Hex SHA-256 of a file, read in pieces."""
    digest = hashlib.sha256()
    with path.open("rb") as stream:
        while piece := stream.read(1 << 20):
            digest.update(piece)
    return digest.hexdigest()


def read_manifest(folder: Path) -> Manifest:
    """Read and check `bundle.json`: format, fields, paths that stay inside the folder. Raises BundleError."""
    path = folder / MANIFEST_NAME
    if not folder.is_dir():
        raise BundleError(f"bundle {folder}: no such folder")
    if not path.is_file():
        raise BundleError(f"bundle {folder}: no {MANIFEST_NAME} in it")
    try:
        manifest = msgspec.json.decode(path.read_bytes(), type=Manifest)
    except msgspec.ValidationError as error:
        raise BundleError(f"bundle {path}: {error}") from None
    except (msgspec.DecodeError, UnicodeDecodeError) as error:
        raise BundleError(f"bundle {path}: not JSON ({error})") from None
    if manifest.format != FORMAT:
        raise BundleError(f"bundle {path}: format {manifest.format!r}, this edgemap reads {FORMAT!r}")
    parts = (manifest.detector, *manifest.odometry.values(), *manifest.variants.values())
    files = [part.file for part in parts]
    for name in [*files, *manifest.sha256]:
        _inside(folder, name)
    for name in files:
        if name not in manifest.sha256:
            raise BundleError(f"bundle {path}: {name} has no sha256")
    return manifest


def write_manifest(folder: Path, manifest: Manifest) -> None:
    """Write `bundle.json`, indented for people."""
    text = msgspec.json.format(msgspec.json.encode(manifest), indent=2)
    (folder / MANIFEST_NAME).write_bytes(text + b"\n")


def _inside(folder: Path, name: str) -> Path:
    parts = PurePosixPath(name)
    if parts.is_absolute() or ".." in parts.parts or "\\" in name or not parts.parts:
        raise BundleError(f"bundle {folder}: path {name!r} leaves the bundle's folder")
    path = folder / parts
    if not path.resolve().is_relative_to(folder.resolve()):
        raise BundleError(f"bundle {folder}: path {name!r} leaves the bundle's folder")
    return path


def verified_file(folder: Path, manifest: Manifest, name: str) -> Path:
    """Path of a bundle's file whose sum has been checked. Raises BundleError naming the file where it differs."""
    path = _inside(folder, name)
    if not path.is_file():
        raise BundleError(f"bundle {folder}: file {name} is missing")
    expected, seen = manifest.sha256[name], sha256_file(path)
    if seen != expected:
        raise BundleError(f"bundle {folder}: {name} has sha256 {seen[:12]}…, manifest says {expected[:12]}…: damaged")
    return path
