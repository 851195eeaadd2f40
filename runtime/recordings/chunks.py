"""The parts of an MCAP file, bounded: records, chunks and attachments never larger than they may be in memory."""

from __future__ import annotations

import zlib
from collections.abc import Iterator
from dataclasses import replace
from heapq import heappop, heappush
from typing import IO, Any

RECORD_LIMIT_BYTES = 128 << 20
CHUNK_LIMIT_BYTES = 64 << 20  # unpacked
HELD_LIMIT_BYTES = 256 << 20  # of chunks that overlap in time


class BoundedStream:
    """A file that refuses to read more at once than a record may hold: mcap reads as much as a length field says."""

    def __init__(self, stream: IO[bytes]) -> None:
        self._stream = stream
        self.seek, self.tell, self.seekable = stream.seek, stream.tell, stream.seekable

    def read(self, count: int = -1) -> bytes:
        """As a file's. Raises ValueError."""
        if not 0 <= count <= RECORD_LIMIT_BYTES:
            raise ValueError(f"a record of {count:,} bytes, at most {RECORD_LIMIT_BYTES:,} are read")
        return self._stream.read(count)


def unpacked(chunk: Any) -> list[Any]:
    """A chunk's records. Raises ValueError for one that is too large or damaged, and what the decompressors raise."""
    from mcap.stream_reader import breakup_chunk

    if chunk.compression == "zstd":
        import zstandard

        decompressor = zstandard.ZstdDecompressor(max_window_size=CHUNK_LIMIT_BYTES)
        data = decompressor.stream_reader(chunk.data).read(CHUNK_LIMIT_BYTES + 1)
    elif chunk.compression == "lz4":
        from lz4.frame import LZ4FrameDecompressor

        data = LZ4FrameDecompressor().decompress(chunk.data, CHUNK_LIMIT_BYTES + 1)
    elif chunk.compression == "":
        data = chunk.data
    else:
        raise ValueError(f"chunks compressed with {chunk.compression!r}, edgemap reads lz4, zstd")
    if len(data) > CHUNK_LIMIT_BYTES:
        raise ValueError(f"a chunk of more than {CHUNK_LIMIT_BYTES:,} bytes")
    return breakup_chunk(replace(chunk, compression="", data=data), validate_crc=True)


def messages_by_time(stream: Any, indexes: list[Any], channels: dict[int, Any]) -> Iterator[Any]:
    """Messages on the channels (by id), in order of log time, from the chunks that the indexes name."""
    from mcap.data_stream import ReadDataStream
    from mcap.records import Chunk, Message

    wanted = [
        index
        for index in indexes
        if not index.message_index_offsets or not channels.keys().isdisjoint(index.message_index_offsets)
    ]
    waiting: list[tuple[int, int, Any]] = []
    held = count = 0
    for index in [*sorted(wanted, key=lambda index: index.message_start_time), None]:
        while waiting and (index is None or waiting[0][0] < index.message_start_time):
            message = heappop(waiting)[2]
            held -= len(message.data)
            yield message
        if index is None:
            return
        stream.seek(index.chunk_start_offset + 9)
        for record in unpacked(Chunk.read(ReadDataStream(stream))):
            if isinstance(record, Message) and record.channel_id in channels:
                heappush(waiting, (record.log_time, count, record))
                held, count = held + len(record.data), count + 1
        if held > HELD_LIMIT_BYTES:
            raise ValueError(f"chunks that overlap in time hold more than {HELD_LIMIT_BYTES:,} bytes")


def attachment(stream: Any, index: Any) -> bytes:
    """An attachment's data, its sum checked. Raises ValueError."""
    from mcap.data_stream import ReadDataStream

    stream.seek(index.offset + 1)
    reader = ReadDataStream(stream)
    record = stream.read(reader.read8())
    expected = int.from_bytes(record[-4:], "little")
    if expected and zlib.crc32(record[:-4]) != expected:
        raise ValueError(f"attachment {index.name} has another sum than it says")
    return record_data(record)


def record_data(record: bytes) -> bytes:
    """The data of an attachment record's bytes."""
    from io import BytesIO

    from mcap.data_stream import ReadDataStream
    from mcap.records import Attachment

    return Attachment.read(ReadDataStream(BytesIO(record))).data
