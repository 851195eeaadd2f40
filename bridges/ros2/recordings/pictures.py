"""Pictures and depth in ROS 2 messages: `Image` and `CompressedImage` to BGR, and to metres.

Depth of our own recordings is `sensor_msgs/CompressedImage` at the pictures' stamps, bit for bit: 16 bits where they
hold every value, as ROS has it (REP 118: `16UC1`, millimetres) or in the finer unit that the format names; else the
four bytes of each float32.
"""

import re
import struct
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from edgemap.bridges.ros2.messages.topics import DEPTH
from edgemap.bridges.ros2.recordings.facts import RECORD
from edgemap.bridges.ros2.recordings.reading import Reading
from edgemap.runtime.frames.errors import CameraError
from edgemap.runtime.frames.faults import FaultKind, note
from edgemap.runtime.frames.frame import png
from edgemap.runtime.frames.reading import one_line
from edgemap.runtime.inputs.drives.pictures import (
    APART_S,
    ENCODINGS,
    PIXEL_LIMIT,
    Depth,
    DepthBeside,
    Levels,
    bgr_of,
    decode_picture,
    decoded,
)

COMPRESSED = ("jpeg", "jpg", "png", "webp", "tiff", "bmp")
DEPTH_WORDS, INFRARED_WORDS = {"depth", "disparity"}, {"infra", "infra1", "infra2", "ir", "infrared", "thermal"}


def kind_of_pictures(topic: str, message: Any) -> str:
    """What the pictures of a topic are, by its first message: colour, infrared (or grey), depth, or the name of an
    encoding that is not read."""
    form = str(getattr(message, "encoding", "") or getattr(message, "format", ""))
    words = set(re.split(r"[/_]", topic.lower()))
    if form == "mono16" or ("; " not in form and not hasattr(message, "encoding")):  # which may be either
        form = "16UC1" if words & DEPTH_WORDS else "mono8" if words & INFRARED_WORDS else form
    if form.startswith(("32FC1", "16UC1")) or "compresseddepth" in form.lower():
        return "depth"
    if form.startswith(("mono8", "8UC1", "mono16")):
        return "infrared"
    known = form in ENCODINGS or (not hasattr(message, "encoding") and not _odd_format(form))
    return "colour" if known else one_line(form, 40) or "unnamed"


def raw_picture(message: Any, name: str, levels: Levels) -> NDArray[np.uint8]:
    """A decoded `sensor_msgs/Image` as BGR, (H, W, 3). levels: of its camera. Raises CameraError for an encoding or a
    size that cannot be."""
    if message.encoding == "mono16":
        grey = levels.eight_bits(_values(message, "u2", name).astype(np.uint16))
        return np.asarray(cv2.cvtColor(grey, cv2.COLOR_GRAY2BGR), dtype=np.uint8)
    if message.encoding not in ENCODINGS:
        raise CameraError(
            f"{name}: Image encoding {one_line(message.encoding, 40)!r} is not supported "
            f"(understood: {', '.join(ENCODINGS)})"
        )
    return bgr_of(_rows(message, ENCODINGS[message.encoding][0], name), message.encoding)


def _rows(message: Any, channels: int, name: str) -> NDArray[np.uint8]:
    """Rows (H, W x channels) of a `sensor_msgs/Image`. channels: bytes of a pixel. Raises CameraError."""
    height, width, step = int(message.height), int(message.width), int(message.step)
    split = channels == 2 and message.encoding in ENCODINGS and width % 2  # two pixels share their colour
    if not 0 < height * width <= PIXEL_LIMIT or split or step < width * channels or len(message.data) < height * step:
        raise CameraError(
            f"{name}: Image of {width}x{height} px {one_line(message.encoding, 40)} with {len(message.data)} bytes in "
            f"rows of {step}"
        )
    return np.frombuffer(message.data, np.uint8, height * step).reshape(height, step)[:, : width * channels]


def compressed_picture(message: Any, name: str, levels: Levels) -> NDArray[np.uint8]:
    """A decoded `sensor_msgs/CompressedImage` as BGR, (H, W, 3).

    format: `jpeg`, `png`, or image_transport's `rgb8; jpeg compressed bgr8`. Raises CameraError for others (depth,
    video codecs) and for damaged pictures.
    """
    if _odd_format(message.format):
        raise CameraError(
            f"{name}: CompressedImage format {one_line(message.format, 40)!r} is not supported "
            f"(understood: {', '.join(COMPRESSED)})"
        )
    return decode_picture(bytes(message.data), name, levels)


PICTURE_KINDS = {"sensor_msgs/Image": raw_picture, "sensor_msgs/CompressedImage": compressed_picture}


def _odd_format(form: str) -> bool:
    """Whether a CompressedImage of this format is no picture that is decoded."""
    words = form.lower().replace(";", " ").split()
    return "compresseddepth" in words or bool(words and not set(words) & set(COMPRESSED))


FARTHEST_M = 100.0  # as medians of a depth picture go: beyond, they are millimetres
PER_METRE = 1000, 10000  # steps of a metre: of nearly every depth camera, and of the near-range ones
DEPTH_NUMBERS = {"32FC1": "f4", "16UC1": "u2", "mono16": "u2"}
FLOATS = "32FC1 in bytes; png"
ALIGNED = "aligned_depth_to_color", "depth_registered"  # in the topic's name: Intel's driver, ROS's image pipeline
# Before the PNG of `compressedDepth`: a format, and A and B of depth = A / (value - B).
QUANTISED = struct.Struct("<iff")


def encoded_depth(depth: Depth) -> tuple[bytes, str]:
    """PNG and format of a depth picture (H, W) in metres."""
    for steps in PER_METRE:
        with np.errstate(invalid="ignore"):
            raw = np.rint(depth * steps).astype(np.uint16)
        if np.array_equal(raw.astype(np.float32) / np.float32(steps), depth):
            return png(raw, quickly=True), f"16UC1; {steps} a metre; png"
    return png(np.ascontiguousarray(depth, dtype="<f4").view(np.uint8).reshape(*depth.shape, 4), quickly=True), FLOATS


def own_depth(message: Any, name: str) -> Depth:
    """The depth that edgemap recorded, (H, W) metres. Raises CameraError."""
    image, form = decoded(bytes(message.data), name, cv2.IMREAD_UNCHANGED), message.format
    steps = {f"16UC1; {steps} a metre; png": steps for steps in PER_METRE}.get(form)
    if image is not None and steps and image.dtype == np.uint16 and image.ndim == 2:
        return image.astype(np.float32) / np.float32(steps)
    if image is not None and form == FLOATS and image.dtype == np.uint8 and image.shape[2:] == (4,):
        return np.ascontiguousarray(image).view("<f4").reshape(image.shape[:2]).astype(np.float32, copy=False)
    raise CameraError(f"{name}: not a depth picture that edgemap recorded")


def raw_depth(message: Any, name: str) -> Depth:
    """A decoded `sensor_msgs/Image` of REP 118: `16UC1`, millimetres, or `32FC1`, metres; millimetres where their
    median is no distance that a depth camera measures. Raises CameraError."""
    if message.encoding not in DEPTH_NUMBERS:
        raise CameraError(f"{name}: Image encoding {one_line(message.encoding, 40)!r} is no depth")
    kind = DEPTH_NUMBERS[message.encoding]
    values = _values(message, kind, name).astype(np.float32)
    return values / np.float32(1000) if kind == "u2" or in_millimetres(values) else _valid_depth(values)


def _values(message: Any, kind: str, name: str) -> NDArray[Any]:
    """Numbers (H, W) of a `sensor_msgs/Image` of one channel. kind: u2 or f4. Raises CameraError."""
    rows = np.ascontiguousarray(_rows(message, int(kind[1]), name))
    return rows.view((">" if message.is_bigendian else "<") + kind)


def in_millimetres(depth: NDArray[Any]) -> bool:
    """Whether depth of 32FC1, in metres by REP 118, is in millimetres."""
    known = depth[np.isfinite(depth) & (depth > 0.0)]
    return bool(len(known)) and float(np.median(known)) > FARTHEST_M


def compressed_depth(message: Any, name: str) -> Depth:
    """A decoded `sensor_msgs/CompressedImage` of compressed_depth_image_transport: `16UC1` or `32FC1; compressedDepth`.

    Raises CameraError.
    """
    form, data = str(message.format), bytes(message.data)
    image = decoded(data[QUANTISED.size :], name, cv2.IMREAD_UNCHANGED)
    if "compressedDepth" not in form or image is None or image.dtype != np.uint16 or image.ndim != 2:
        raise CameraError(f"{name}: {one_line(form, 40)} is not compressedDepth as PNG")
    if form.startswith("16UC1"):
        return image.astype(np.float32) / np.float32(1000)
    _, share, offset = QUANTISED.unpack_from(data)
    with np.errstate(divide="ignore", invalid="ignore"):
        return _valid_depth(np.where(image > 0, np.float32(share) / (image - np.float32(offset)), np.float32(0)))


def _valid_depth(depth: NDArray[Any]) -> Depth:
    """Depth (H, W) as a Frame has it, 0 where unknown."""
    return np.where(np.isfinite(depth) & (depth > 0.0), depth, 0.0).astype(np.float32)


READERS: dict[str, Callable[[Any, str], Depth]] = {
    "sensor_msgs/Image": raw_depth,
    "sensor_msgs/CompressedImage": compressed_depth,
}


def depth_beside(recording: Reading, wanted: str | None = None) -> tuple[str, DepthBeside] | None:
    """The topic with the depth of a recording's pictures, and that depth by stamps in ns; None without any: the topic
    that is stated, else what edgemap recorded, or the first that its name calls registered to the colour picture.
    Raises CameraError where there is no such topic, or it is not depth."""
    ours = wanted is None and DEPTH in recording.topics and RECORD in recording.metadata
    kinds = {name: known.kind for name, known in recording.topics.items() if known.kind in READERS and known.count}
    topic = DEPTH if ours else wanted or aligned(kinds)
    if topic is None:
        return None
    if not ours and topic not in kinds:
        raise CameraError(f"{recording.path}: no topic {topic} of sensor_msgs Image or CompressedImage, for depth")
    read, apart = (own_depth, 0) if ours else (READERS[kinds[topic]], round(APART_S * 1e9))
    if not ours:
        first = recording.first(topic)
        if getattr(first, "encoding", "") == "32FC1" and in_millimetres(np.frombuffer(bytes(first.data), "<f4")):
            note(FaultKind.DEPTH, f"{topic}: 32FC1 is in millimetres (metres by REP 118), divided by 1000")
    samples = ((ns, message) for ns, _, message, _ in recording.samples(topic) if ns is not None)
    return topic, DepthBeside(((ns, partial(read, message, topic)) for ns, message in samples), apart)


def aligned(kinds: Mapping[str, str]) -> str | None:
    """The first raw picture topic whose name marks depth aligned to the colour picture. kinds: by topic."""
    raw = (name for name, kind in kinds.items() if kind == "sensor_msgs/Image")
    return next((name for name in raw if any(word in name for word in ALIGNED)), None)
