"""Training data of a floor head: labelled folders, and photographs that a teacher labels first, DeepLabV3+ on
MobileNetV2, trained on ADE20K (mlcommons/mobile_models)."""

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.special import expit, logit, softmax
from tqdm import tqdm

from edgemap.export.errors import ExportError
from edgemap.export.floor.pictures import Image, Pair
from edgemap.runtime.frames.disk import write_atomically
from edgemap.runtime.frames.frame import png
from edgemap.runtime.frames.reading import one_line, user_path
from edgemap.runtime.inputs.drives.pictures import list_pictures, read_picture
from edgemap.runtime.inputs.drives.truth import floor_pairs, paired

Teacher = Callable[[Image], Image]
FLOORS = (4, 29)  # of the teacher's 32 classes: floor, rug
WALLS = (1, 15)  # wall, door
# Sizes at which the teacher sees a picture, as shares of its input's sides; the picture's reflection fills the rest.
# The lower border of a photograph is then not that of the input, where the teacher expects floor.
SCALES = (1.0, 0.7, 0.5)
FLOOR_BIAS = 1.0  # added to the logit of the mean probability of floor, which is too low
SHARPNESS = 2.0  # factor on that logit: a mean over views is less confident than each of them
LEAST_WEIGHT = 0.1  # of a pixel whose probability of floor is a half


def open_teacher(path: Path, threads: int = 1) -> Teacher:
    """A function from a BGR picture to its shares of other, floor and wall, (h, w, 3) uint8 in 255ths, from a .tflite
    file whose output is (1, h, w, 32) logits: means over several sizes of the picture and of its mirror image. The
    three add up to the label's weight, which is the smaller the less sure the teacher is of the floor.

    Raises ExportError for another network, or without the extra `teacher`.
    """
    try:
        from ai_edge_litert.interpreter import Interpreter  # pyright: ignore[reportMissingImports]  # an extra
    except ImportError:
        raise ExportError("--teacher needs ai-edge-litert: pip install 'edgemap-robot[teacher]'") from None
    try:
        network = Interpreter(str(path), num_threads=threads)
        network.allocate_tensors()
        picture, logits = network.get_input_details()[0], network.get_output_details()[0]
    except Exception as error:  # it raises whatever it likes at files that are none
        raise ExportError(f"{path}: not a TensorFlow Lite file ({one_line(error, 120)})") from None
    if len(logits["shape"]) != 4 or logits["shape"][3] <= max(FLOORS) or picture["dtype"] is not np.uint8:
        raise ExportError(f"{path}: expected a uint8 picture in, (1, h, w, 32) logits out, not {list(logits['shape'])}")
    _, rows, columns, _ = picture["shape"].tolist()
    scale, zero = logits["quantization"]

    def shares(small: Image) -> NDArray[np.float32]:
        network.set_tensor(picture["index"], cv2.cvtColor(small, cv2.COLOR_BGR2RGB)[None])
        network.invoke()
        found = softmax((network.get_tensor(logits["index"])[0].astype(np.float32) - zero) * scale, axis=2)
        floor, wall = (found[..., list(group)].sum(axis=2) for group in (FLOORS, WALLS))
        return np.stack([1.0 - floor - wall, floor, wall], axis=2)

    def both_sides(image: Image) -> NDArray[np.float32]:
        small = np.asarray(cv2.resize(image, (columns, rows), interpolation=cv2.INTER_AREA), np.uint8)
        return (shares(small) + shares(small[:, ::-1])[:, ::-1]) / 2.0

    return lambda image: _weighted(np.mean([_at_scale(both_sides, image, scale) for scale in SCALES], axis=0))


def _at_scale(shares: Callable[[Image], NDArray[np.float32]], image: Image, scale: float) -> NDArray[np.float32]:
    """The shares of a picture that is padded with its reflection, and takes that share of the result's sides."""
    height, width = image.shape[:2]
    above, beside = (round(side * (1.0 / scale - 1.0) / 2.0) for side in (height, width))
    larger = cv2.copyMakeBorder(image, above, above, beside, beside, cv2.BORDER_REFLECT_101)
    found = shares(np.asarray(larger, np.uint8))
    rows, columns = found.shape[:2]
    top, left = round(above * rows / (height + 2 * above)), round(beside * columns / (width + 2 * beside))
    return np.asarray(cv2.resize(found[top : rows - top, left : columns - left], (columns, rows)), np.float32)


def _weighted(mean: NDArray[np.float32]) -> Image:
    """Weighted shares in 255ths of mean probabilities of other, floor and wall (h, w, 3), the floor's calibrated."""
    floor = expit(SHARPNESS * (logit(np.clip(mean[..., 1], 1e-4, 1.0 - 1e-4)) + FLOOR_BIAS))
    wall = np.minimum(mean[..., 2], 1.0 - floor)
    weight = np.maximum(np.abs(2.0 * floor - 1.0), LEAST_WEIGHT)[..., None]
    return np.rint(255.0 * weight * np.stack([1.0 - floor - wall, floor, wall], axis=2)).astype(np.uint8)


def labelled(spec: str, teacher: Teacher | None, labels: Path) -> list[Pair]:
    """Pictures and label files of `floor:DIR`, `drive:DIR` with floor/, or a plain folder that the teacher labels.

    labels: folder for its shares; existing ones are kept. Raises ExportError or CameraError.
    """
    kind, colon, folder = spec.partition(":")
    if colon and kind in ("floor", "drive"):
        return floor_pairs(user_path(folder))
    source = user_path(spec)
    if not source.is_dir():
        raise ExportError(f"{spec}: expected floor:DIR, drive:DIR with floor/, or a folder of pictures")
    if teacher is None:
        raise ExportError(f"{spec}: pictures without floor labels need a --teacher")
    images = list_pictures(source)
    labels.mkdir(parents=True, exist_ok=True)
    missing = [path for path in images if not (labels / f"{path.stem}.png").is_file()]
    for path in tqdm(missing, unit=" labels", disable=None):
        write_atomically(labels / f"{path.stem}.png", png(teacher(read_picture(path))))
    return paired(images, labels)
