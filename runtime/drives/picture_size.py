"""Width and height of a picture file from its first bytes, before anything decodes it."""

import re
import struct

PIXEL_LIMIT = 1 << 26  # 67 million: 200 MB as BGR, and decoders need as much again
SIDE_LIMIT = 65_536
_PNM = re.compile(rb"P[2356]\s(?:\s|#[^\n]*\n)*(\d{1,9})\s(?:\s|#[^\n]*\n)*(\d{1,9})\s")
_JPEG_SIZES = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}
_TIFF_TYPES = {3: "H", 4: "I"}  # SHORT, LONG


def picture_size(data: bytes) -> tuple[int, int] | None:
    """(width, height) in px of a PNG, JPEG, BMP, PNM, TIFF or WebP file; None for anything else, or where it is cut."""
    try:
        if data.startswith(b"\x89PNG\r\n\x1a\n") and data[12:16] == b"IHDR":
            return struct.unpack_from(">II", data, 16)
        if data.startswith(b"\xff\xd8"):
            return _jpeg(data)
        if data.startswith(b"BM"):
            return _bmp(data)
        if data.startswith((b"II*\0", b"MM\0*")):
            return _tiff(data, "<" if data.startswith(b"II") else ">")
        if data.startswith(b"RIFF") and data[8:12] == b"WEBP":
            return _webp(data)
        found = _PNM.match(data[:4096])
        return (int(found[1]), int(found[2])) if found else None
    except struct.error:  # cut short
        return None


def _jpeg(data: bytes) -> tuple[int, int] | None:
    """From the largest frame header: a file may hold more than one."""
    at, largest = 2, None
    while at + 4 <= len(data) and data[at] == 0xFF:
        kind = data[at + 1]
        if kind == 0xFF:  # fill
            at += 1
            continue
        if kind == 0xDA:  # the picture's own data
            break
        if kind in _JPEG_SIZES:
            height, width = struct.unpack_from(">HH", data, at + 5)
            largest = max(largest or (0, 0), (width, height), key=lambda size: size[0] * size[1])
        bare = kind == 0x01 or 0xD0 <= kind <= 0xD8
        at += 2 if bare else 2 + struct.unpack_from(">H", data, at + 2)[0]
    return largest


def _bmp(data: bytes) -> tuple[int, int]:
    (size,) = struct.unpack_from("<I", data, 14)
    width, height = struct.unpack_from("<HH" if size == 12 else "<ii", data, 18)
    return abs(width), abs(height)


def _tiff(data: bytes, order: str) -> tuple[int, int] | None:
    (at,) = struct.unpack_from(f"{order}I", data, 4)
    (count,) = struct.unpack_from(f"{order}H", data, at)
    sides: dict[int, int] = {}
    for entry in range(at + 2, at + 2 + 12 * min(count, 1000), 12):
        tag, kind = struct.unpack_from(f"{order}HH", data, entry)
        if tag in (256, 257) and kind in _TIFF_TYPES:
            sides[tag] = max(sides.get(tag, 0), struct.unpack_from(order + _TIFF_TYPES[kind], data, entry + 8)[0])
    return (sides[256], sides[257]) if len(sides) == 2 else None


def _webp(data: bytes) -> tuple[int, int] | None:
    if data[12:16] == b"VP8X":
        width, height = (int.from_bytes(data[at : at + 3], "little") + 1 for at in (24, 27))
        return width, height
    if data[12:16] == b"VP8L":
        (bits,) = struct.unpack_from("<I", data, 21)
        return (bits & 0x3FFF) + 1, (bits >> 14 & 0x3FFF) + 1
    if data[12:16] == b"VP8 ":
        width, height = struct.unpack_from("<HH", data, 26)
        return width & 0x3FFF, height & 0x3FFF
    return None
