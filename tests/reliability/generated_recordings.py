"""Second fuzzer: MCAP files of valid structure and hostile content, pictures and videos built part by part."""

from __future__ import annotations

import math
import struct
import zlib
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from random import Random
from typing import Any

import cv2
import numpy as np

from edgemap.runtime.frames.messages.definitions import FIELDS, encoder
from edgemap.runtime.inputs.cameras.video import VideoCamera
from edgemap.runtime.inputs.drives.pictures import decode_picture
from edgemap.runtime.inputs.recordings.camera import RecordingCamera
from edgemap.runtime.inputs.recordings.facts import RECORD, TRUTH_FILE, WHEEL_FILE
from edgemap.runtime.inputs.recordings.pictures import ENCODINGS
from edgemap.runtime.inputs.recordings.sensors import read_wheel
from reliability import drawing as d
from reliability.drawing import ValueSource
from reliability.generated_documents import PIXELS, _attachment, _drain, _facts, _finite
from reliability.workers import ReaderCase

JPEG = cv2.imencode(".jpg", np.full((48, 64, 3), 90, np.uint8))[1].tobytes()


def cases(scratch: Path) -> list[ReaderCase]:
    """Recordings, pictures and videos. scratch: for the videos that are taken apart."""
    videos = _videos(scratch)
    return [
        ReaderCase("pictures", _picture, lambda _, data: _shape(decode_picture(data, "a.png"))),
        ReaderCase("MCAP, camera", lambda random: _bag(random, pictures=True), _use_camera),
        ReaderCase("MCAP, wheels", lambda random: _bag(random, pictures=False), _use_wheels),
        ReaderCase("videos", lambda random: _video(random, videos), _use_video),
    ]


def _shape(image: Any) -> None:
    assert image.dtype == np.uint8
    assert image.ndim == 3
    assert image.shape[2] == 3


# Recordings: ROS messages drawn from their definitions, in files whose every record may lie.


def _message(draw: ValueSource, kind: str) -> dict[str, Any]:
    """A message of a kind, every field drawn."""
    found: dict[str, Any] = {}
    for line in FIELDS[kind].split("\n"):
        base, name = line.split()[:2]
        base, _, length = base.partition("[")
        if not length:
            found[name] = _field(draw, base)
        else:
            count = int(length[:-1]) if length[:-1] else draw.count(9)
            found[name] = bytes(count) if base == "uint8" else [_field(draw, base) for _ in range(count)]
    return found


def _field(draw: ValueSource, base: str) -> Any:
    if base in FIELDS:
        return _message(draw, base)
    match base:
        case "string":
            return draw.text().replace("\0", "")
        case "float64":
            return (
                draw.real(-2.0, 2.0)
                if not draw.hurt()
                else draw.pick((math.nan, math.inf, -math.inf, 1e308, -0.0, 5e-324))
            )
        case "float32":
            return draw.real(-2.0, 2.0)
        case "bool":
            return draw.chance(0.5)
    bits = int("".join(letter for letter in base if letter.isdigit()))
    least, most = (0, 2**bits - 1) if base.startswith("u") else (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1)
    return draw.whole(least, most) if draw.hurt() else draw.whole(0, min(most, 1000))


def _raw_image(draw: ValueSource) -> dict[str, Any]:
    encoding = draw.pick(tuple(ENCODINGS)) if not draw.hurt() else draw.text().replace("\0", "")
    channels = ENCODINGS.get(encoding, (3, None))[0]
    width, height = draw.pick((64, 64, 2, 3, 1)), draw.pick((48, 48, 1, 3))
    step = width * channels + draw.pick((0, 0, 5))
    fields = {
        "height": height,
        "width": width,
        "encoding": encoding,
        "is_bigendian": 0,
        "step": step,
        "data": bytes(height * step),
    }
    if draw.hurt():
        fields[draw.pick(("height", "width", "step"))] = draw.pick((0, 1, 65537, 2**26, 2**32 - 1))
    return {"header": _header(draw)} | fields


def _header(draw: ValueSource) -> dict[str, Any]:
    stamp = {"sec": draw.pick((0, 1, 1_700_000_000, 2**31 - 1)), "nanosec": draw.whole(0, 10**9)}
    if draw.hurt():
        stamp = {"sec": draw.pick((-1, -(2**31))), "nanosec": 2**32 - 1}
    return {"stamp": stamp, "frame_id": draw.pick(("lens", "lens", "/lens", draw.text().replace("\0", "")))}


def _turn(draw: ValueSource) -> dict[str, float]:
    """A rotation: of a camera that looks ahead, straight down, or anywhere."""
    rows = [[0.0] * 4]
    d.unit(draw, rows, 0)
    half = math.sqrt(0.5)
    steep = draw.pick((0.0, 0.2, math.pi / 2, -math.pi / 2, math.pi / 2 - 1e-9)) / 2.0
    pitch, optical = (
        (0.0, math.sin(steep), 0.0, math.cos(steep)),
        (-half * half, half * half, -half * half, half * half),
    )
    return dict(zip("xyzw", rows[0] if draw.chance(0.4) else _product(pitch, optical), strict=True))


def _product(a: tuple[float, ...], b: tuple[float, ...]) -> list[float]:
    (ax, ay, az, aw), (bx, by, bz, bw) = a, b
    return [
        aw * bx + ax * bw + ay * bz - az * by, aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw, aw * bw - ax * bx - ay * by - az * bz,
    ]  # fmt: skip


def _tf(draw: ValueSource) -> dict[str, Any]:
    frames = ["base_footprint", "base_link", "middle", "lens"]
    transforms = []
    for parent, child in pairwise(frames):
        if draw.hurt():
            parent, child = draw.pick(frames), draw.pick(frames)
        place = dict(
            zip(
                "xyz",
                (draw.real(-1.0, 1.0) if not draw.hurt() else draw.real(-1e9, 1e9) for _ in range(3)),
                strict=True,
            )
        )
        header = _header(draw) | {"frame_id": parent}
        transforms.append(
            {"header": header, "child_frame_id": child, "transform": {"translation": place, "rotation": _turn(draw)}}
        )
    return {"transforms": transforms}


def _info(draw: ValueSource) -> dict[str, Any]:
    fields = _message(draw, "sensor_msgs/CameraInfo")
    numbers = [60.0 if not draw.hurt() else draw.pick((0.0, -1.0, math.nan, math.inf, 1e300)) for _ in range(4)]
    fx, cx, fy, cy = numbers
    fields |= {
        "width": 64,
        "height": 48,
        "k": [fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0],
        "distortion_model": "plumb_bob",
    }
    fields["p"] = [fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0]
    fields["d"] = [draw.real(-0.3, 0.3) for _ in range(draw.pick((0, 4, 5, 5, 8, 12)))]
    if draw.hurt():
        fields["distortion_model"] = draw.pick(("rational_polynomial", "equidistant", "\x1b[2J"))
    return fields


def _rolled(draw: ValueSource) -> dict[str, Any]:
    fields = _message(draw, "nav_msgs/Odometry")
    yaw = draw.real(-3.1, 3.1)
    turn = (
        dict(zip("xyzw", (0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2)), strict=True))
        if not draw.hurt()
        else _turn(draw)
    )
    fields["pose"]["pose"] = {"position": {"x": draw.real(-1.0, 1.0), "y": 0.0, "z": 0.0}, "orientation": turn}
    if draw.hurt():
        fields["pose"]["pose"]["position"]["x"] = draw.pick((math.nan, math.inf, 1e7, 1e300, 500.0))
    return fields | {"header": _header(draw)}


MAKERS: dict[str, Callable[[ValueSource], dict[str, Any]]] = {
    "sensor_msgs/Image": _raw_image, "sensor_msgs/CameraInfo": _info, "tf2_msgs/TFMessage": _tf, "nav_msgs/Odometry": _rolled,
    "sensor_msgs/CompressedImage": lambda draw: {
        "header": _header(draw), "data": draw.pick((PIXELS, JPEG)) if not draw.hurt() else _picture(draw.random),
        "format": draw.pick(("jpeg", "png", "rgb8; jpeg compressed bgr8", "")) if not draw.hurt() else draw.pick(("h264", "16UC1; compressedDepth", "\x1b")),
    },
}  # fmt: skip


def _bag(random: Random, pictures: bool) -> bytes:
    draw = ValueSource(random, damage=random.choice((0.0, 0.0, 0.003, 0.01, 0.05)))
    kinds = [draw.pick(("sensor_msgs/Image", "sensor_msgs/CompressedImage"))] if pictures and not draw.hurt() else []
    kinds += ["nav_msgs/Odometry"] if not pictures and not draw.hurt() else []
    kinds += [draw.pick((*MAKERS, "std_msgs/Float64", "sensor_msgs/Imu")) for _ in range(draw.count(5))]
    channels, messages = [], []
    for number, kind in enumerate(kinds):
        topic = {"tf2_msgs/TFMessage": "/tf", "std_msgs/Float64": "/camera/stamp_s"}.get(
            kind, f"/t{number}/{draw.pick(('image', 'image_rect'))}"
        )
        name = kind.replace("/", "/msg/") if not draw.hurt() else draw.pick((draw.text(), "a/b", "sensor_msgs/msg/Imu"))
        topic = topic if not draw.hurt() else draw.text()
        how = (
            ("cdr", "ros2msg") if not draw.hurt() else draw.pick((("json", "jsonschema"), ("", ""), ("cdr", "omgidl")))
        )
        channels.append((number + 1, topic, name, how))
        for row in range(draw.pick((1, 2, 3, 5))):
            try:
                fields = MAKERS[kind](draw) if kind in MAKERS else _message(draw, kind)
                data = bytes(encoder(kind)(fields))
            except (struct.error, OverflowError, TypeError, KeyError):
                data = b""
            if draw.hurt():
                cut = draw.random.randrange(len(data) + 1)
                data = draw.pick(
                    (
                        data[:cut],
                        data + b"\0" * 9,
                        b"",
                        b"\0\1\0\0" + data[4:],
                        data[:cut] + b"\xff\xff\xff\xff" + data[cut + 4 :],
                    )
                )
            stamp = 10**9 * (row + 1) if not draw.hurt() else draw.pick((0, 2**63, 2**64 - 1))
            messages.append((number + 1 if not draw.hurt() else draw.pick((0, 99, 65535)), stamp, data))
    draw.random.shuffle(messages)
    return _file(draw, channels, messages)


def _file(draw: ValueSource, channels: list[Any], messages: list[Any]) -> bytes:
    """The records of an MCAP file with its index, or without; sums, lengths and offsets right unless `draw` hurts."""
    out = bytearray(b"\x89MCAP0\r\n")

    def lies(value: int, most: int = 2**64 - 1) -> int:
        return value if not draw.hurt() else draw.pick((0, 1, value + 1, max(value - 1, 0), most, len(out), most // 2))

    def text(value: str | bytes) -> bytes:
        data = value.encode("utf-8", "surrogatepass") if isinstance(value, str) else value
        return struct.pack("<I", lies(len(data), 2**32 - 1)) + (data if not draw.hurt() else data + b"\xff")

    def record(opcode: int, body: bytes) -> bytes:
        return struct.pack("<BQ", opcode if not draw.hurt() else draw.pick((0, 5, 9, 77, 255)), lies(len(body))) + body

    def pairs(items: dict[str, str]) -> bytes:
        body = b"".join(text(str(key)) + text(str(value)) for key, value in items.items())
        return struct.pack("<I", lies(len(body), 2**32 - 1)) + body

    definitions = b""
    for number, topic, name, (encoding, schema) in channels:
        definitions += record(
            3, struct.pack("<H", number) + text(name) + text(schema) + text(draw.pick((b"", b"x" * 50)))
        )
        definitions += record(
            4, struct.pack("<HH", number, lies(number, 65535)) + text(topic) + text(encoding) + pairs({})
        )
    out += record(1, text("ros2") + text("fuzz"))
    chunked, counts, index = draw.chance(0.7), {}, b""
    bodies = [record(5, struct.pack("<HIQQ", number, 0, stamp, stamp) + data) for number, stamp, data in messages]
    for number, _, _ in messages:
        counts[number] = counts.get(number, 0) + 1
    if not chunked:
        out += definitions + b"".join(bodies)
    half = draw.random.randrange(len(bodies) + 1)
    for first, group in ((0, bodies[:half]), (half, bodies[half:])) if chunked else ():
        stamps = [stamp for _, stamp, _ in messages[first : first + len(group)]] or [0]
        inner = (definitions if first == 0 or draw.chance(0.8) else b"") + b"".join(group)
        compression, packed = _packed(draw, inner)
        at, crc = len(out), zlib.crc32(inner) if draw.chance(0.6) else 0
        body = struct.pack("<QQQI", min(stamps), max(stamps), lies(len(inner)), lies(crc, 2**32 - 1)) + text(
            compression
        )
        chunk = record(6, body + struct.pack("<Q", lies(len(packed))) + packed)
        out += chunk
        offsets = (
            b"".join(struct.pack("<HQ", number, lies(len(out))) for number in sorted(counts))
            if draw.chance(0.7)
            else b""
        )
        entry = struct.pack(
            "<QQQQI", lies(min(stamps)), max(stamps), lies(at), lies(len(chunk)), lies(len(offsets), 2**32 - 1)
        )
        index += record(
            8, entry + offsets + struct.pack("<Q", 0) + text(compression) + struct.pack("<QQ", len(packed), len(inner))
        )
        if draw.hurt():
            index += index
    for name in (WHEEL_FILE, TRUTH_FILE):
        if draw.chance(0.25):
            data, at = _attachment(draw.random), len(out)
            body = (
                struct.pack("<QQ", 0, 0)
                + text(name)
                + text("application/json")
                + struct.pack("<Q", lies(len(data)))
                + data
            )
            whole = record(9, body + struct.pack("<I", draw.pick((0, lies(zlib.crc32(body), 2**32 - 1)))))
            out += whole
            index += record(
                10, struct.pack("<QQQQQ", lies(at), lies(len(whole)), 0, 0, len(data)) + text(name) + text("")
            )
    if draw.chance(0.4):
        at, whole = len(out), record(12, text(RECORD if not draw.hurt() else draw.text()) + pairs(_facts(draw.random)))
        out += whole
        index += record(13, struct.pack("<QQ", lies(at), lies(len(whole))) + text(RECORD))
    out += record(15, struct.pack("<I", 0 if draw.chance(0.8) else lies(zlib.crc32(bytes(out)), 2**32 - 1)))
    start = len(out)
    if indexed := draw.chance(0.8):
        out += (definitions if not draw.hurt() else b"") + index
        per_channel = b"".join(struct.pack("<HQ", number, lies(count)) for number, count in counts.items())
        out += record(
            11,
            struct.pack("<QHIIIIQQ", len(messages), 0, 0, 0, 0, 0, 0, 0)
            + struct.pack("<I", len(per_channel))
            + per_channel,
        )
    out += record(2, struct.pack("<QQI", lies(start) if indexed else 0, 0, 0)) + b"\x89MCAP0\r\n"
    cut = draw.random.randrange(len(out))
    return bytes(out) if draw.chance(0.9) or not draw.damage else bytes(out[:cut])


def _packed(draw: ValueSource, data: bytes) -> tuple[str, bytes]:
    kind = draw.pick(("", "zstd", "lz4")) if not draw.hurt() else draw.pick(("bz2", "zstd", "lz4", "\x1b[2J"))
    if kind == "zstd" and not draw.hurt():
        import zstandard

        return kind, zstandard.compress(data)
    if kind == "lz4" and not draw.hurt():
        import lz4.frame

        return kind, lz4.frame.compress(data)
    return kind, data


def _use_camera(folder: Path, data: bytes) -> None:
    path = folder / "a.mcap"
    path.write_bytes(data)
    with RecordingCamera(str(path)) as camera:
        if camera.mount is not None:
            _finite(camera.mount.rotation_base_optical())
        assert camera.rate_hz is None or (math.isfinite(camera.rate_hz) and camera.rate_hz > 0.0)
        _drain(camera)


def _use_wheels(folder: Path, data: bytes) -> None:
    path = folder / "a.mcap"
    path.write_bytes(data)
    way = read_wheel(str(path))
    _finite([pose.vector() for pose in way.poses])
    _finite(way.stamps_s)


# Pictures, built part by part, every header field drawn.


def _picture(random: Random) -> bytes:
    draw = ValueSource(random, damage=random.choice((0.0, 0.02, 0.1, 0.3)))
    return draw.pick((_png, _png, _jpeg, _jpeg, _bmp, _pnm, _tiff, _webp))(draw)


def _side(draw: ValueSource) -> int:
    return (
        draw.pick((1, 2, 3, 16, 64, 100))
        if not draw.hurt()
        else draw.pick((0, 2048, 20_000, 65_535, 65_537, 2**31 - 1, 2**31, 2**32 - 1))
        if draw.chance(0.97)
        else 8192
    )


def _png(draw: ValueSource) -> bytes:
    width, height = _side(draw), _side(draw)
    colour, depth = draw.pick(((0, 8), (2, 8), (6, 8), (3, 8), (4, 8), (0, 1), (0, 16), (2, 16), (6, 16), (3, 4)))
    if draw.hurt():
        colour, depth = draw.pick((0, 1, 5, 7, 255)), draw.pick((0, 3, 8, 32))
    channels = {0: 1, 2: 3, 3: 1, 4: 2, 6: 4}.get(colour, 3)
    row = (min(width, 200) * channels * depth + 7) // 8
    pixels = b"".join(
        bytes([draw.pick((0, 0, 1, 2, 3, 4)) if not draw.hurt() else 9]) + draw.random.randbytes(row)
        for _ in range(min(height, 200))
    )

    def chunk(kind: bytes, data: bytes) -> bytes:
        length = len(data) if not draw.hurt() else draw.pick((0, 2**31 - 1, 2**32 - 1, len(data) + 1))
        crc = zlib.crc32(kind + data) if not draw.hurt() else 0
        return struct.pack(">I", length) + kind + data + struct.pack(">I", crc)

    head = struct.pack(">IIBBBBB", width, height, depth, colour, 0, 0, draw.pick((0, 0, 1)))
    parts = [chunk(b"IHDR", head)]
    if colour == 3 or draw.hurt():
        parts.append(chunk(b"PLTE", draw.random.randbytes(draw.pick((3, 48, 768)) if not draw.hurt() else 4)))
    for kind in (b"acTL", b"tRNS", b"gAMA", b"iCCP", b"eXIf", b"pHYs", b"zTXt"):
        if draw.chance(0.06):
            data = (
                struct.pack(">II", draw.pick((1, 2, 2**31 - 1)), 0)
                if kind == b"acTL"
                else draw.random.randbytes(draw.pick((0, 2, 9, 60)))
            )
            parts.append(chunk(kind, data))
    if draw.chance(0.06):
        parts.append(chunk(b"fcTL", struct.pack(">IIIIIHHBB", 0, _side(draw), _side(draw), 0, 0, 1, 10, 0, 0)))
    packed = zlib.compress(pixels, 1)
    cut = draw.random.randrange(len(packed) + 1) if draw.chance(0.3) else len(packed)
    parts += (
        [chunk(b"IDAT", packed[:cut]), chunk(b"IDAT", packed[cut:])] if cut < len(packed) else [chunk(b"IDAT", packed)]
    )
    if not draw.hurt():
        parts.append(chunk(b"IEND", b""))
    return b"\x89PNG\r\n\x1a\n" + b"".join(parts if not draw.hurt() else draw.random.sample(parts, len(parts)))


def _jpeg(draw: ValueSource) -> bytes:
    """The segments of a small JPEG, frame header and tables changed, others added."""
    side = draw.pick((8, 17, 64))
    quality = [cv2.IMWRITE_JPEG_QUALITY, draw.pick((5, 90)), cv2.IMWRITE_JPEG_PROGRESSIVE, draw.pick((0, 1))]
    picture = np.frombuffer(draw.random.randbytes(side * side * 3), np.uint8).reshape(side, side, 3)
    data = bytearray(cv2.imencode(".jpg", picture, quality)[1].tobytes())
    at = 2
    while at + 4 < len(data) and data[at + 1] != 0xDA:
        length = int.from_bytes(data[at + 2 : at + 4], "big")
        if data[at + 1] in (0xC0, 0xC2) and draw.hurt():
            data[at + 5 : at + 9] = struct.pack(">HH", min(_side(draw), 65_535), min(_side(draw), 65_535))
        if draw.hurt():
            data[at + 4 + draw.random.randrange(max(length - 2, 1))] = draw.random.randrange(256)
        if draw.hurt():
            extra = draw.random.randbytes(draw.pick((0, 2, 30)))
            data[at:at] = (
                bytes([0xFF, draw.pick((0xE1, 0xFE, 0xDD, 0xC4, 0xC0, 0xD9, 0x00))])
                + struct.pack(">H", len(extra) + 2)
                + extra
            )
        at += 2 + int.from_bytes(data[at + 2 : at + 4], "big")
    return bytes(data) if not draw.hurt() else bytes(data[: draw.random.randrange(len(data))])


def _bmp(draw: ValueSource) -> bytes:
    width, height, bits = (
        _side(draw),
        _side(draw) * draw.pick((1, 1, -1)),
        draw.pick((1, 4, 8, 16, 24, 32)) if not draw.hurt() else 7,
    )
    wrap = lambda value: (value + 2**31) % 2**32 - 2**31  # noqa: E731
    head = struct.pack(
        "<iihhIIiiII",
        wrap(width),
        wrap(height),
        1,
        bits,
        draw.pick((0, 0, 0, 1, 2, 3)),
        0,
        0,
        0,
        draw.pick((0, 0, 256, 2**32 - 1)),
        0,
    )
    body = draw.random.randbytes(min(abs(width) * abs(height) * bits // 8 + 4 * abs(height), 100_000))
    start = 54 if not draw.hurt() else draw.pick((0, 14, 2**31, 2**32 - 1))
    return (
        b"BM"
        + struct.pack("<IHHI", 54 + len(body), 0, 0, start)
        + struct.pack("<I", draw.pick((40, 40, 12, 108, 124)))
        + head
        + body
    )


def _pnm(draw: ValueSource) -> bytes:
    width, height, most = (
        _side(draw),
        _side(draw),
        draw.pick((255, 255, 1, 65535)) if not draw.hurt() else draw.pick((0, -1, 10**9)),
    )
    kind = (
        draw.pick((b"P2", b"P3", b"P5", b"P6", b"P6")) if not draw.hurt() else draw.pick((b"P1", b"P7", b"Pf", b"P9"))
    )
    gap = draw.pick((b" ", b"\n", b"\n# c\n"))
    body = draw.random.randbytes(min(width * height * 3 * (2 if most > 255 else 1), 100_000))
    return kind + b"\n" + str(width).encode() + gap + str(height).encode() + b"\n" + str(most).encode() + b"\n" + body


def _tiff(draw: ValueSource) -> bytes:
    order = draw.pick(("<", ">"))
    width, height = _side(draw), _side(draw)
    pixels = draw.random.randbytes(min(width * height * 3, 100_000))
    tags = [
        (256, 4, width), (257, 4, height), (258, 3, draw.pick((8, 8, 1, 16, 32, 64))), (259, 3, draw.pick((1, 1, 1, 5, 7, 8, 32773, 34712))),
        (262, 3, draw.pick((0, 1, 2, 2, 3, 5, 6))), (273, 4, 8), (277, 3, draw.pick((1, 3, 3, 4, 255))), (278, 4, height), (279, 4, len(pixels)),
        (322, 4, _side(draw)), (323, 4, _side(draw)), (339, 3, draw.pick((1, 2, 3))),
    ]  # fmt: skip
    kept = sorted(tag for tag in tags if tag[0] not in (322, 323, 339) or draw.chance(0.1))
    at = 8 + len(pixels)
    entries = b"".join(
        struct.pack(
            f"{order}HHI",
            tag,
            kind if not draw.hurt() else draw.pick((1, 2, 5, 12, 99)),
            1 if not draw.hurt() else 2**32 - 1,
        )
        + (struct.pack(f"{order}HH", value % 65536, 0) if kind == 3 else struct.pack(f"{order}I", value % 2**32))
        for tag, kind, value in kept
    )
    start = at if not draw.hurt() else draw.pick((0, 8, at + 1, 2**32 - 1))
    return (
        (b"II*\0" if order == "<" else b"MM\0*")
        + struct.pack(f"{order}I", start)
        + pixels
        + struct.pack(f"{order}H", len(kept))
        + entries
        + struct.pack(f"{order}I", draw.pick((0, 0, 8, at)))
    )


def _webp(draw: ValueSource) -> bytes:
    picture = np.frombuffer(draw.random.randbytes(16 * 16 * 3), np.uint8).reshape(16, 16, 3)
    data = bytearray(cv2.imencode(".webp", picture, [cv2.IMWRITE_WEBP_QUALITY, draw.pick((50, 101))])[1].tobytes())
    if draw.chance(0.4):
        canvas = (
            struct.pack("<I", min(_side(draw), 2**24) - 1 & 0xFFFFFF)[:3]
            + struct.pack("<I", min(_side(draw), 2**24) - 1 & 0xFFFFFF)[:3]
        )
        extended = b"VP8X" + struct.pack("<I", 10) + bytes([draw.pick((0, 0x02, 0x10, 0x3E)), 0, 0, 0]) + canvas
        data[12:12] = extended
        data[4:8] = struct.pack("<I", len(data) - 8)
    for _ in range(draw.count(9) if draw.hurt() else 0):
        data[draw.random.randrange(12, len(data))] = draw.random.randrange(256)
    return bytes(data) if not draw.hurt() else bytes(data[: draw.random.randrange(len(data))])


# Videos: the boxes of small files of this machine's own encoder, their fields drawn.


def _videos(scratch: Path) -> list[bytes]:
    made = []
    for name, code in (("a.mp4", "mp4v"), ("a.avi", "MJPG")):
        path = scratch / name
        writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*code), 10.0, (64, 48))
        for shade in range(6):
            writer.write(np.full((48, 64, 3), 40 * shade, np.uint8))
        writer.release()
        if path.is_file() and path.stat().st_size:
            made.append(path.read_bytes())
    return made


def _video(random: Random, videos: list[bytes]) -> bytes:
    draw = ValueSource(random, damage=random.choice((0.0, 0.02, 0.1)))
    if draw.chance(0.1):  # other demuxers: playlists and scripts that name other files
        return draw.pick((
            b"#EXTM3U\n#EXT-X-TARGETDURATION:1\n#EXTINF:1,\n/etc/passwd\n#EXT-X-ENDLIST\n", b"ffconcat version 1.0\nfile '/etc/passwd'\n",
            b"v=0\no=- 0 0 IN IP4 127.0.0.1\nm=video 9 RTP/AVP 96\n", b"<?xml version='1.0'?><MPD></MPD>", draw.random.randbytes(300),
        ))  # fmt: skip
    data = bytearray(draw.pick(videos))
    marks = [
        b"moov",
        b"mvhd",
        b"tkhd",
        b"mdhd",
        b"stsd",
        b"stts",
        b"stsz",
        b"stco",
        b"stsc",
        b"avcC",
        b"esds",
        b"mdat",
        b"avih",
        b"strh",
        b"strf",
        b"movi",
        b"idx1",
        b"00dc",
    ]
    for mark in marks:
        at = data.find(mark)
        if at < 0 or not draw.chance(0.15 + 2 * draw.damage):
            continue
        place = at + draw.pick((-4, 4, 8, 12, 16, 20, 24, 28, 32, 36, 40))
        if 0 <= place < len(data) - 4:
            data[place : place + 4] = struct.pack(
                draw.pick(("<I", ">I")), draw.pick((0, 1, 2, 64, 8192, 65535, 2**31 - 1, 2**31, 2**32 - 1))
            )
    if draw.chance(0.15):
        data = data[: draw.random.randrange(len(data))]
    return bytes(data)


def _use_video(folder: Path, data: bytes) -> None:
    path = folder / "video.mp4"
    path.write_bytes(data)
    with VideoCamera("fuzz", path) as camera:
        _drain(camera)
