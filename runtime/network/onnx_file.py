"""Metadata of an ONNX file, read without loading its graph, so that the robot needs no onnx package."""

from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

OPSET_IMPORT, METADATA = 8, 14  # fields of onnx.proto's ModelProto
MODEL_BYTES = 512 << 20
PAIR_BYTES = 8 << 20  # of one key and value; a contract is as long as its manifest at most


@dataclass(frozen=True, slots=True)
class OnnxFacts:
    """opset: version of the default operator set. metadata: the file's own keys and values."""

    opset: int
    metadata: dict[str, str]


def onnx_facts(path: Path) -> OnnxFacts | None:
    """Walk the top level of the protobuf; None where the file is cut, is no ONNX file, or longer than MODEL_BYTES.

    Fields 1 and 2 of OperatorSetIdProto are domain and version, of StringStringEntryProto key and value.
    """
    size, opset, metadata = path.stat().st_size, None, {}
    if size > MODEL_BYTES:
        return None
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
                if key >> 3 in (OPSET_IMPORT, METADATA) and value <= PAIR_BYTES:
                    pair = _pair(stream, end)
                    if key >> 3 == OPSET_IMPORT and pair.get(1, b"") in (b"", b"ai.onnx"):
                        opset = pair.get(2, opset)
                    elif key >> 3 == METADATA:
                        metadata[_text(pair.get(1))] = _text(pair.get(2))
                stream.seek(end)
    return OnnxFacts(opset, metadata) if isinstance(opset, int) else None


def _pair(stream: BinaryIO, end: int) -> dict[int, bytes | int]:
    """Fields of a small message up to `end`: bytes of those with a length, else the number."""
    fields: dict[int, bytes | int] = {}
    while stream.tell() < end:
        key, value = _varint(stream), _varint(stream)
        if key is None or value is None or (key & 7 == 2 and value > end - stream.tell()):
            break
        fields[key >> 3] = stream.read(value) if key & 7 == 2 else value
    return fields


def _text(value: bytes | int | None) -> str:
    return value.decode("utf-8", "replace") if isinstance(value, bytes) else ""


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
