"""The bundle: what export writes and the robot loads, checked before anything runs.

A bundle is a folder of `bundle.json` (this module's `Manifest`) and ONNX files. Sums are checked before a file is
parsed; the contract in each ONNX file's metadata must equal the manifest's.
"""

import json
from typing import Annotated, Any, Literal

import msgspec
from msgspec import Meta

from edgemap.runtime.frames.reading import HIDDEN, Coordinate, Name, Share, Size, Strict
from edgemap.runtime.network.layouts import Reading

METADATA_KEY = "edgemap.contract"

FileName = Annotated[str, Meta(max_length=200, pattern=rf"\A[^{HIDDEN}]*\Z")]  # `_inside` checks where it leads
Sha256 = Annotated[str, Meta(pattern=r"\A[0-9a-f]{64}\Z")]
Dimension = Annotated[int, Meta(ge=1, le=1 << 20)]
Shape = Annotated[tuple[Dimension, ...], Meta(min_length=1, max_length=8)]
Stride = Annotated[int, Meta(ge=1, le=4096)]
InputSide = Annotated[int, Meta(ge=8, le=4096)]  # px
Deviation = Annotated[float, Meta(gt=0.0, le=1e6)]
Text = Annotated[str, Meta(max_length=10_000)]


class ClassEntry(Strict):
    """One class of the detector. mapped: false for classes that are detected but never mapped: people, pets, and small
    things that are carried or lie on tables.
    """

    name: Name
    mapped: bool = True


class InputSpec(Strict):
    """How a picture becomes the network's input tensor, (1, 3, height, width) float32.

    resize: `stretch` (aspect lost), `letterbox` (centred) or `letterbox_topleft`. pad: the letterbox's
    grey, 0..255, before scaling. colour: channel order. scale: factor on 0..255 values, then mean and std.
    """

    name: Name
    width: InputSide
    height: InputSide
    resize: Literal["stretch", "letterbox", "letterbox_topleft"]
    colour: Literal["rgb", "bgr"]
    scale: Annotated[float, Meta(gt=0.0, le=1e3)]
    pad: Annotated[int, Meta(ge=0, le=255)] = 114
    mean: tuple[Coordinate, Coordinate, Coordinate] = (0.0, 0.0, 0.0)
    std: tuple[Deviation, Deviation, Deviation] = (1.0, 1.0, 1.0)


class HeadSpec(Strict):
    """One raw detection output of the backbone.

    yolov3: (1, A*(5+C), H, W) logits, anchors (w, h) in input pixels, scale_xy as Darknet's `scale_x_y`.
    yolox: (1, N, 5+C) for all strides in one tensor, rows ordered stride by stride; scores already sigmoid.
    dfl: (1, C+32, H, W): class logits, then 8 bins for each side of the box (left, top, right, bottom).
    """

    name: Name
    shape: Shape
    strides: Annotated[tuple[Stride, ...], Meta(min_length=1, max_length=16)]
    anchors: Annotated[tuple[tuple[Size, Size], ...], Meta(max_length=100)] = ()
    scale_xy: Annotated[float, Meta(ge=-100.0, le=100.0)] = 1.0


class FeatureSpec(Strict):
    """A map that the backbone gives, such as one that feeds the odometry: name, shape (1, C, H, W), stride in input
    pixels."""

    name: Name
    shape: Shape
    stride: Stride


class FloorSpec(FeatureSpec):
    """The backbone output that labels the floor: probabilities (1, len(labels), H, W), stride in input pixels."""

    labels: Annotated[tuple[Literal["floor", "wall"], ...], Meta(min_length=1, max_length=2)]


class StateSpec(Strict):
    """A recurrent state tensor: input name, output name, shape; starts filled with `initial`."""

    input: Name
    output: Name
    shape: Shape
    initial: Coordinate = 0.0


class DetectorSpec(Strict):
    """The backbone file and how to read it. decode: the rule that turns heads into boxes. floor: the output that is
    the floor mask, where it has one. reading: of a file as another project exports it, whose heads need not be maps."""

    file: FileName
    input: InputSpec
    decode: Literal["yolov3", "yolox", "dfl", "reading"]
    heads: Annotated[tuple[HeadSpec, ...], Meta(min_length=1, max_length=16)]
    features: Annotated[tuple[FeatureSpec, ...], Meta(max_length=16)]
    classes: Annotated[tuple[ClassEntry, ...], Meta(min_length=1, max_length=10_000)]
    floor: FloorSpec | None = None
    reading: Reading | None = None

    def outputs(self) -> dict[str, tuple[int, ...]]:
        """Name and shape of all that the backbone gives."""
        floor = () if self.floor is None else (self.floor,)
        return {item.name: item.shape for item in (*self.heads, *floor, *self.features)}


class OdometryHead(Strict, forbid_unknown_fields=False):
    """A stepwise learned odometry: features and states in, motion and states out.

    feature: the name of the backbone output that it reads. motion: the output's name, (1, 3) float32 holding
    forward_m, left_m, yaw_rad of the base since the previous frame. trained: false for random weights. window:
    motions after which the state starts again from the last frame, because it was trained on clips of so many and runs
    away beyond; 0 for never. Older bundles hold a kind `flow` too, which nothing reads.
    """

    file: FileName
    kind: str
    feature: Name
    feature_input: Name
    motion: Name
    states: Annotated[tuple[StateSpec, ...], Meta(max_length=16)]
    parameters: Annotated[int, Meta(ge=0, le=1 << 40)]
    trained: bool
    window: Annotated[int, Meta(ge=0, le=1 << 40)] = 0
    sigma_forward_m: Deviation = 0.05
    sigma_left_m: Deviation = 0.05
    sigma_yaw_rad: Deviation = 0.05


class Parity(Strict):
    """What export proved about one file: the largest absolute difference of torch or source model and onnxruntime."""

    max_abs_difference: Size
    tolerance: Size
    steps: int
    cases: int


class BundleVariant(Strict):
    """A file that may run in the detector's place: same inputs, outputs and contract, other numbers inside.

    measured: by export, against the float32 file: pictures, differences, AP50 where there was truth, and time.
    """

    file: FileName
    measured: dict[str, Any] = msgspec.field(default_factory=dict)


class Manifest(Strict):
    """`bundle.json`. sha256: of every other file in the folder, by its relative path.

    variants: by precision, `int8`.

    envelope: of older bundles; nothing reads it. confidence: minimum score of a box without --confidence;
    sure_confidence: then of one with half the weight for a new object; class_scores: of single classes. measured:
    figures with their data. sources: where the weights came from.
    """

    format: str
    name: Name
    version: Name
    detector: DetectorSpec
    sha256: Annotated[dict[FileName, Sha256], Meta(max_length=100)]
    odometry: dict[Name, OdometryHead] = msgspec.field(default_factory=dict)
    variants: dict[Literal["int8"], BundleVariant] = msgspec.field(default_factory=dict)
    parity: dict[str, Parity] = msgspec.field(default_factory=dict)
    envelope: dict[Name, Any] = msgspec.field(default_factory=dict)
    confidence: Share = 0.3
    sure_confidence: Share = 0.0
    class_scores: dict[Name, Share] = msgspec.field(default_factory=dict)
    measured: dict[str, Any] = msgspec.field(default_factory=dict)
    licence: Text = ""
    sources: tuple[Text, ...] = ()


def contract_metadata(record: DetectorSpec | OdometryHead) -> str:
    """The contract in an ONNX file's metadata under `METADATA_KEY`: canonical JSON without the file name."""
    document = msgspec.to_builtins(record)
    document.pop("file")
    for later in ("floor", "reading"):  # that contracts of before do not have
        if document.get(later, "") is None:
            document.pop(later)
    for volatile in ("trained", "window", "sigma_forward_m", "sigma_left_m", "sigma_yaw_rad"):
        document.pop(volatile, None)
    return json.dumps(document, sort_keys=True, separators=(",", ":"))
