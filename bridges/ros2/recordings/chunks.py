"""The parts of an MCAP file, bounded: records, chunks and attachments never larger than they may be in memory."""

import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from heapq import heappop, heappush
from io import BytesIO
from typing import IO, Any

MAGIC = b"\x89MCAP0\r\n"
RECORD_LIMIT_BYTES = 128 << 20  # of chunks, messages and attachments
SMALL_LIMIT_BYTES = 1 << 20  # of every other record: what they hold takes many times their own size in memory
SUMMARY_LIMIT_BYTES = 32 << 20
CHUNK_LIMIT_BYTES = 64 << 20  # unpacked
HELD_LIMIT_BYTES = 256 << 20  # of messages that wait for their turn
HELD_MESSAGE_BYTES = 500  # what one takes beside its data
CHANNEL_LIMIT, NAME_LENGTH = 10_000, 256
FOOTER_BYTES = 29


@dataclass(slots=True)
class Definitions:
    """The schemas and channels of a file, by id, without their unused texts and metadata."""

    schemas: dict[int, Any] = field(default_factory=dict)
    channels: dict[int, Any] = field(default_factory=dict)

    def add(self, record: Any) -> None:
        """Keeps a schema or channel; ignores other records. Raises ValueError for invalid names, and for too many."""
        from mcap.records import Channel, Schema

        if isinstance(record, Schema):
            name, kept = record.name, self.schemas
            record.data = b""
        elif isinstance(record, Channel):
            name, kept = record.topic, self.channels
            record.metadata = {}
        else:
            return
        if len(name) > NAME_LENGTH or not name.isprintable():
            raise ValueError(f"a name of {len(name)} characters that is none: {name[:40]!r}")
        kept[record.id] = record
        if len(kept) > CHANNEL_LIMIT:
            raise ValueError(f"more than {CHANNEL_LIMIT:,} topics")


@dataclass(slots=True)
class Summary:
    """The summary section at the end of an indexed file."""

    definitions: Definitions = field(default_factory=Definitions)
    chunks: list[Any] = field(default_factory=list)
    attachments: list[Any] = field(default_factory=list)
    metadata: list[Any] = field(default_factory=list)
    statistics: Any = None


def records(stream: IO[bytes], crc: int | None = None) -> Iterator[Any]:
    """The records from here to the footer, or to the stream's end; unused kinds are skipped.

    crc: of what came before in the data section, checked where that ends; None does not check. Raises ValueError for a
    record that is too large or fails its checksum, EOFError for a truncated file, and mcap's errors for damage.
    """
    from mcap import records as mcap
    from mcap.data_stream import ReadDataStream
    from mcap.opcode import Opcode

    kinds: dict[int, Any] = {
        Opcode.SCHEMA: mcap.Schema, Opcode.CHANNEL: mcap.Channel, Opcode.CHUNK: mcap.Chunk,
        Opcode.METADATA: mcap.Metadata, Opcode.STATISTICS: mcap.Statistics, Opcode.CHUNK_INDEX: mcap.ChunkIndex,
        Opcode.ATTACHMENT_INDEX: mcap.AttachmentIndex, Opcode.METADATA_INDEX: mcap.MetadataIndex,
        Opcode.DATA_END: mcap.DataEnd, Opcode.FOOTER: mcap.Footer,
    }  # fmt: skip
    large = (Opcode.CHUNK, Opcode.MESSAGE, Opcode.ATTACHMENT)
    while head := stream.read(9):
        opcode, length = struct.unpack("<BQ", head)
        limit = SMALL_LIMIT_BYTES if opcode in kinds and opcode not in large else RECORD_LIMIT_BYTES
        if length > limit:
            raise ValueError(f"a record of {length:,} bytes, at most {limit:,} are read")
        data = stream.read(length)
        if len(data) < length:
            raise EOFError("the file ends inside a record")
        if opcode == Opcode.MESSAGE:
            channel_id, sequence, log_time, publish_time = struct.unpack_from("<HIQQ", data)
            yield mcap.Message(channel_id, log_time, data[22:], publish_time, sequence)
        elif opcode == Opcode.ATTACHMENT:
            yield checked_attachment(data)
        elif opcode in kinds:
            record = kinds[opcode].read(ReadDataStream(BytesIO(data)))
            if isinstance(record, mcap.DataEnd) and crc is not None and record.data_section_crc not in (0, crc):
                raise ValueError(f"crc of the data is {crc}, the file says {record.data_section_crc}")
            yield record
            if isinstance(record, mcap.Footer):
                return
        if crc is not None:
            crc = zlib.crc32(data, zlib.crc32(head, crc))


def read_summary(stream: IO[bytes], size: int) -> Summary | None:
    """The summary of a complete file of `size` bytes; None where it has none. Raises as `records` does."""
    from mcap import records as mcap

    stream.seek(size - len(MAGIC) - FOOTER_BYTES)
    footer = next(records(stream), None)
    if not isinstance(footer, mcap.Footer):
        raise ValueError("no footer at its end")
    if footer.summary_start == 0:
        return None
    length = size - footer.summary_start
    if not 0 < length <= SUMMARY_LIMIT_BYTES:
        raise ValueError(f"a summary of {length:,} bytes, at most {SUMMARY_LIMIT_BYTES:,} are read")
    stream.seek(footer.summary_start)
    summary = Summary()
    lists = {
        mcap.ChunkIndex: summary.chunks, mcap.AttachmentIndex: summary.attachments, mcap.MetadataIndex: summary.metadata
    }  # fmt: skip
    for record in records(BytesIO(stream.read(length))):
        if type(record) in lists:
            lists[type(record)].append(record)
        elif isinstance(record, mcap.Statistics):
            summary.statistics = record
        else:
            summary.definitions.add(record)
    if len({index.chunk_start_offset for index in summary.chunks}) < len(summary.chunks):
        raise ValueError("a chunk stands in its index twice")
    return summary


def unpacked(chunk: Any) -> Iterator[Any]:
    """A chunk's records. Raises ValueError for one that is too large or damaged, and the decompressors' errors."""
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
    if chunk.uncompressed_crc and zlib.crc32(data) != chunk.uncompressed_crc:
        raise ValueError(f"crc of a chunk is {zlib.crc32(data)}, the file says {chunk.uncompressed_crc}")
    return records(BytesIO(data))


def messages_by_time(stream: IO[bytes], indexes: list[Any], channels: dict[int, Any]) -> Iterator[Any]:
    """Messages on the channels (by id), in order of log time, from the chunks that the indexes name."""
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
            held -= len(message.data) + HELD_MESSAGE_BYTES
            yield message
        if index is None:
            return
        stream.seek(index.chunk_start_offset)
        chunk = next(records(stream), None)
        if not isinstance(chunk, Chunk):
            raise ValueError("no chunk where its index says")
        for record in unpacked(chunk):
            if isinstance(record, Message) and record.channel_id in channels:
                heappush(waiting, (record.log_time, count, record))
                held, count = held + len(record.data) + HELD_MESSAGE_BYTES, count + 1
                if held > HELD_LIMIT_BYTES:
                    raise ValueError(f"more than {HELD_LIMIT_BYTES:,} bytes of messages at one time")


def checked_attachment(record: bytes) -> Any:
    """An attachment from its record's bytes. Raises ValueError where its sum is another."""
    from mcap.data_stream import ReadDataStream
    from mcap.records import Attachment

    expected = int.from_bytes(record[-4:], "little")
    attachment = Attachment.read(ReadDataStream(BytesIO(record)))
    if expected and zlib.crc32(record[:-4]) != expected:
        raise ValueError(f"attachment {attachment.name!r} has another sum than it says")
    return attachment
