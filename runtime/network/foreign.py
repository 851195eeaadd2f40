"""Detectors as other projects export them: an ONNX file's input and outputs are recognised on pictures with labelled
boxes."""

import ast
import json
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.objects.visibility import iou
from edgemap.runtime.frames.class_names import COCO_91, COCO_NAMES, is_mapped
from edgemap.runtime.frames.errors import BundleError
from edgemap.runtime.frames.reading import convert, decode_json, library_path, one_line, print_message, read_bytes
from edgemap.runtime.network.bundle import Bundle
from edgemap.runtime.network.engines import open_session, run_session
from edgemap.runtime.network.layouts import FORMS, Arrays, Layout, Reading, in_unit, layouts, parts, rows_of
from edgemap.runtime.network.manifest import ClassEntry, DetectorSpec, HeadSpec, InputSpec, Manifest
from edgemap.runtime.network.manifest_file import FORMAT, sha256_file
from edgemap.runtime.network.network import Compute, Network
from edgemap.runtime.network.preprocess import Placement, Preprocessor

Scaling = Mapping[str, Any]
IMAGENET = {"mean": (0.485, 0.456, 0.406), "std": (0.229, 0.224, 0.225)}  # of RGB pictures


def _scaling(colour: str, in_unit: bool, normalised: bool = False) -> Scaling:
    """Order of the channels, and whether they are in 0..1 rather than 0..255, and normalised as ImageNet is."""
    normal = {name: values[:: 1 if colour == "rgb" else -1] for name, values in IMAGENET.items() if normalised}
    return {"colour": colour, "scale": 1 / 255 if in_unit else 1.0} | normal


RGB, RGB_255, BGR_255 = _scaling("rgb", True), _scaling("rgb", False), _scaling("bgr", False)
RGB_NORMAL, BGR_NORMAL = _scaling("rgb", True, True), _scaling("bgr", True, True)
SCALINGS = (RGB, RGB_NORMAL, BGR_255, BGR_NORMAL, RGB_255)
RESIZES = ("letterbox", "letterbox_topleft", "stretch")
USUAL = {"cells": BGR_255, "bins": RGB_NORMAL, "corner bins": BGR_NORMAL}  # of one family each: their authors'
STRETCHED: frozenset[Layout] = frozenset({"queries", "lists", "bin rows", "bin levels", "label score box rows"})
# Frames of the demo, and the objects of each that detectors of photographs recognise: chairs, a couch, a plant.
PROBES = {270: (7, 8), 370: (6, 7, 8), 420: (1, 14)}
MINIMUM_SCORE, OVERLAP = 0.25, 0.5  # of a box of a probe, and with the true one
NEARLY = 0.9  # of the best agreement, from where on the family's usual reading is taken; of a picture that a box covers


@dataclass(frozen=True, slots=True)
class Recognised:
    """How a file is read, and what shows it.

    agreement: sum of the scores of boxes that cover known boxes of the probes, of which there are `known`, under their
    label; 0 of 0 for a detector of other classes. everywhere: most of its boxes are the whole picture.
    """

    input: InputSpec
    reading: Reading
    names: tuple[str, ...]
    agreement: float
    known: int
    everywhere: bool

    def __str__(self) -> str:
        spec, reading = self.input, self.reading
        scale = "0..255" if spec.scale == 1.0 else "0..1 normalised" if any(spec.mean) else "0..1"
        scores = {"none": "probabilities", "sigmoid": "logits", "softmax": "logits of a softmax"}[reading.activation]
        proof = f"score {self.agreement:.1f} on {self.known} known boxes" if self.known else "no known boxes to check"
        return (
            f"{reading.layout}, {reading.form}{' as shares' if reading.share else ''}, {scores}; {spec.colour.upper()} "
            f"{scale}, {spec.resize} {spec.width}x{spec.height}; {len(self.names)} classes; {proof}"
        )


class ForeignFile:
    """An ONNX file of another project: its picture in whatever order and type, its other inputs filled in."""

    def __init__(self, path: Path, compute: Compute) -> None:
        """Raises BundleError where it does not load or has no input for a picture."""
        self.path, self._session = path, open_session(path, compute)
        self.metadata: dict[str, str] = self._session.get_modelmeta().custom_metadata_map
        inputs = self._session.get_inputs()
        pictures = [one for one in inputs if len(one.shape) in (3, 4) and 3 in (one.shape[-1], one.shape[-3])]
        if len(pictures) != 1:
            shapes = ", ".join(f"{one.name} {one.shape}" for one in inputs)
            raise BundleError(f"{path}: expected one input for a picture of 3 channels, its inputs are {shapes}")
        (self.picture,) = pictures
        self._last = self.picture.shape[-3] != 3  # channels last, as TensorFlow has them
        self.type = {"tensor(uint8)": np.uint8, "tensor(float16)": np.float16}.get(self.picture.type, np.float32)
        sides = self.picture.shape[-3:-1] if self._last else self.picture.shape[-2:]
        stated = _literal(self.metadata.get("imgsz", ""))
        usual = stated if isinstance(stated, list) and len(stated) == 2 else [640, 640]
        self.height, self.width = (
            side if isinstance(side, int) and side > 0 else int(free) for side, free in zip(sides, usual, strict=True)
        )
        self._others = {one.name: self._filled(one) for one in inputs if one is not self.picture}
        self.outputs = tuple(one.name for one in self._session.get_outputs())

    def _filled(self, one: Any) -> NDArray:
        """What exports take besides the picture: the size that boxes are wanted in, or how the picture was scaled."""
        kind = np.int64 if "int64" in one.type else np.int32 if "int32" in one.type else np.float32
        if "scale" in one.name:
            return np.ones((1, 2), kind)
        if len(one.shape) == 2 and one.shape[1] == 2:
            sides = (self.width, self.height) if "orig" in one.name else (self.height, self.width)
            return np.array([sides], kind)
        raise BundleError(f"{self.path}: input {one.name} {one.shape} is not known; export the file without it")

    def run(self, tensor: NDArray[np.float32]) -> dict[str, NDArray]:
        """All outputs by name, of a tensor (1, 3, height, width). Raises BundleError."""
        shaped = tensor.transpose(0, 2, 3, 1) if self._last else tensor
        shaped = (np.rint(shaped) if self.type is np.uint8 else shaped).astype(self.type)
        shaped = shaped if len(self.picture.shape) == 4 else shaped[0]
        outputs = run_session(self._session, {self.picture.name: shaped, **self._others}, self.path)
        arrays = [np.asarray(array) for array in outputs]
        halves = [array.astype(np.float32) if array.dtype == np.float16 else array for array in arrays]
        return dict(zip(self.outputs, halves, strict=True))

    def shapes(self) -> dict[str, tuple[int, ...]]:
        """Names and shapes of the outputs, of a black picture. Raises BundleError."""
        black = np.zeros((1, 3, self.height, self.width), np.float32)
        return {name: array.shape for name, array in self.run(black).items()}

    def described(self) -> str:
        """Names and shapes of the outputs, for messages."""
        return ", ".join(f"{one_line(name, 40)} {shape}" for name, shape in self.shapes().items())


@dataclass(frozen=True, slots=True, eq=False)
class Probe:
    """A picture of the package with boxes (N, 4) xyxy px that detectors of photographs find, and their labels."""

    image: NDArray[np.uint8]
    boxes: NDArray[np.float64]
    labels: tuple[str, ...]


Answers = list[tuple[Probe, Arrays, Placement]]


def probes() -> Iterator[Probe]:
    """The pictures of the demo on which foreign files are tried."""
    folder = Path(str(files("edgemap.runtime.inputs.demo")))
    frames = json.loads((folder / "boxes.json").read_bytes())["frames"]
    video = cv2.VideoCapture(library_path(folder / "video.mp4"))
    for number, objects in PROBES.items():
        video.set(cv2.CAP_PROP_POS_FRAMES, number)
        picture = np.asarray(video.read()[1], np.uint8)
        clear = [one for one in frames[number] if one["id"] in objects]
        boxes = np.array([one["box"] for one in clear], dtype=np.float64)
        yield Probe(picture, boxes, tuple(one["label"] for one in clear))
    video.release()


def recognise(file: ForeignFile, names: Sequence[str] | None = None, checked: bool = True) -> Recognised:
    """Input and reading of a file, by its metadata and by which reading gives the probes' boxes.

    names: of the classes, where the user states them. checked: refuse what detects nothing on the probes, as random
    weights do. Raises BundleError, in one line with what was tried.
    """
    task = file.metadata.get("task", "detect")
    if task not in ("detect", "segment", "pose"):
        raise BundleError(f"{file.path}: made for the task {one_line(task, 40)!r}, a detector is needed")
    ours = "names" in file.metadata and "stride" in file.metadata  # as Ultralytics exports
    stated, pictures = tuple(names) if names else _stated_names(file.metadata), list(probes())
    scalings = (RGB_255,) if file.type is np.uint8 else (RGB,) if ours else SCALINGS
    best = _best(file, stated, pictures, [(scaling, RESIZES[0]) for scaling in scalings])
    if not ours:
        form, layout = best.reading.form, best.reading.layout
        resize = "stretch" if layout in STRETCHED else "letterbox_topleft" if form == "cells" else RESIZES[0]
        scaling = {key: getattr(best.input, key) for key in ("colour", "scale", "mean", "std")}
        ways = [(scaling, one) for one in sorted(RESIZES, key=lambda one: one != resize)]
        ways = [(USUAL[form], resize), *ways] if form in USUAL else ways
        best = _best(file, stated, pictures, ways)
    if best.everywhere and checked:
        raise BundleError(f"{file.path}: as {best}, every box is the whole picture: state its classes with --names")
    if best.known and best.agreement < OVERLAP and checked:
        raise BundleError(
            f"{file.path}: no reading of its outputs ({file.described()}) gives boxes where the probe pictures "
            f"have {best.known} chairs, couches and plants (score {best.agreement:.2f}): state its classes with --names"
        )
    return best


def _best(
    file: ForeignFile, stated: tuple[str, ...] | None, pictures: list[Probe], ways: Sequence[tuple[Scaling, str]]
) -> Recognised:
    """The first way and reading whose agreement is nearly that of the best one."""
    tried: list[Recognised] = []
    for scaling, resize in ways:
        fields = {"name": file.picture.name, "width": file.width, "height": file.height, "resize": resize, **scaling}
        spec, answers = convert(fields, InputSpec, file.path, BundleError), Answers()
        preprocess = Preprocessor(spec)
        for probe in pictures:
            tensor, placement = preprocess(probe.image)
            answers.append((probe, file.run(tensor), placement))
        for reading, named in _readings(answers, stated):
            with suppress(ValueError):  # cells that are none of this input's, labels that have no name
                tried.append(_judged(spec, reading, named, answers))
    if not tried:
        lacking = f"no layout that edgemap reads, or more classes than {len(stated) if stated else 'COCO has'}"
        raise BundleError(f"{file.path}: outputs {file.described()} have {lacking}: state them with --names")
    most = max(one.agreement for one in tried)
    return next(one for one in tried if one.agreement >= NEARLY * most)


def _readings(answers: Answers, stated: tuple[str, ...] | None) -> Iterator[tuple[Reading, tuple[str, ...]]]:
    """Readings that these outputs may have, the usual ones first, with the names of their classes."""
    outputs = answers[0][1]
    for layout in layouts(outputs):
        arrays = [parts(one, layout) for _, one, _ in answers]
        count = arrays[0][1].shape[1] if arrays[0][2] is None else None
        for names in _names(count, layout, stated):
            surplus = count == len(names) + 1  # DETR's class of no object
            scores = [np.atleast_2d(array.T)[: len(names) + surplus] for _, array, _ in arrays]  # of a class in a row
            activation = "none" if all(map(in_unit, scores)) else "softmax" if surplus else "sigmoid"
            best = [np.argsort(-values.max(axis=0))[:10] for values in scores]
            strongest = [boxes[rows] for (boxes, *_), rows in zip(arrays, best, strict=True)]
            largest = max(float(np.abs(boxes).max(initial=0.0)) for boxes in strongest)
            for form in FORMS[layout]:
                share = largest <= 2.0 and form in ("cxcywh", "xyxy", "yxyx")  # else pixels: a box may leave the input
                yield Reading(layout=layout, form=form, share=share, activation=activation), names


def _names(count: int | None, layout: Layout, stated: tuple[str, ...] | None) -> list[tuple[str, ...]]:
    """Names that so many values of a box may stand for; none where it is not their number."""
    if count is None:
        return [stated] if stated else [COCO_NAMES, COCO_91]
    surplus = {0, 32, 51}  # behind the classes: nothing, or masks or keypoints of Ultralytics
    if layout in ("queries", "bin rows", "bin levels"):
        surplus = {0, 1} if layout == "queries" else {0}
    known = [stated] if stated else [COCO_NAMES, COCO_91[1:], COCO_91]
    return [names for names in known if count - len(names) in surplus][-1:]


def _judged(spec: InputSpec, reading: Reading, names: tuple[str, ...], answers: Answers) -> Recognised:
    """A reading with its agreement on the probes. Raises ValueError where the outputs are not of it."""
    agreement, known, whole, count = 0.0, 0, 0, 0
    for probe, outputs, placement in answers:
        corners, scores, labels = rows_of(outputs, reading, len(names), MINIMUM_SCORE, (spec.width, spec.height))
        boxes = placement.to_image(corners)
        areas = np.prod(boxes[:, 2:] - boxes[:, :2], axis=1) / (placement.image_width * placement.image_height)
        count, whole = count + len(areas), whole + int((areas > NEARLY).sum())
        for box, label in zip(probe.boxes, probe.labels, strict=True):
            if label in names:
                same = labels == names.index(label)
                covers = iou(box, boxes[same]) >= OVERLAP
                known, agreement = known + 1, agreement + float(scores[same][covers].max(initial=0.0))
    return Recognised(spec, reading, names, agreement, known, whole > count / 2)


def _stated_names(metadata: Mapping[str, str]) -> tuple[str, ...] | None:
    """Class names in a file's metadata, as Ultralytics writes them; None without."""
    names = _literal(metadata.get("names", ""))
    if isinstance(names, dict):
        names = list(names.values())
    return tuple(one_line(name, 100) for name in names) if isinstance(names, list | tuple) and names else None


def _literal(text: str) -> Any:
    """A literal of Python; None where the text is none."""
    try:
        return ast.literal_eval(text)
    except (ValueError, SyntaxError, RecursionError, MemoryError):
        return None


def load_foreign(path: Path, compute: Compute, names: Sequence[str] | None) -> Bundle:
    """A detector of another project as a bundle that has boxes alone. Raises BundleError.

    How it is read stands in a FILE.bundle.json next to FILE.onnx where there is one, else it is recognised; standard
    error states what was recognised. names: of its classes, where neither its metadata nor COCO have them.
    """
    file, beside = ForeignFile(path, compute), path.with_suffix(".bundle.json")
    if beside.is_file():
        manifest = decode_json(read_bytes(beside, BundleError), Manifest, beside, BundleError)
        if manifest.detector.reading is None:
            raise BundleError(f"{beside}: has no reading of {path.name}")
    else:
        recognised = recognise(file, names)
        print_message(f"bundle {path.name}: {recognised}")
        manifest = _manifest(file, recognised)
    spec = manifest.detector.input
    outputs = {head.name: head.shape for head in manifest.detector.heads}
    network = Network(
        {spec.name: (1, 3, spec.height, spec.width)},
        outputs,
        lambda tensors: list(file.run(tensors[spec.name]).values()),
        file.metadata,
    )
    return Bundle(path.parent, manifest, network, compute, lambda _rows: network)


def _manifest(file: ForeignFile, recognised: Recognised) -> Manifest:
    """The contract of a file as it was recognised."""
    heads = tuple(
        HeadSpec(name=name, shape=tuple(max(side, 1) for side in shape) or (1,), strides=(1,))
        for name, shape in file.shapes().items()
    )
    classes = tuple(ClassEntry(name=name, mapped=is_mapped(name)) for name in recognised.names)
    detector = DetectorSpec(
        file=file.path.name, input=recognised.input, decode="reading", heads=heads, features=(), classes=classes,
        reading=recognised.reading,
    )  # fmt: skip
    sums = {file.path.name: sha256_file(file.path)}
    return Manifest(
        format=FORMAT, name=one_line(file.path.stem, 100), version="of another project", detector=detector, sha256=sums
    )
