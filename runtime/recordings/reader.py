"""Reads any MCAP file of ROS 2 messages, whole or cut off: its topics, and messages in order of time."""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from edgemap.runtime.errors import CameraError
from edgemap.runtime.recordings.extra import need_mcap

MAGIC = b"\x89MCAP0\r\n"
RECORD_LIMIT_BYTES = 1 << 30
COMPRESSIONS = ("", "lz4", "zstd")


@dataclass(slots=True)
class Topic:
    """One topic: ROS 2 type in its short form (`sensor_msgs/Image`), how it is encoded, messages seen or announced."""

    kind: str
    encoding: str
    count: int = 0


class McapReading:
    """An open MCAP file. whole: it has its end; else everything up to the cut is there to be read.

    topics: by name. metadata, attachments: by name. Raises CameraError, one line, for what is no MCAP file and for
    damage inside a whole one.
    """

    def __init__(self, path: Path) -> None:
        need_mcap()
        from mcap_ros2.decoder import DecoderFactory

        self.path = path
        try:
            self._stream = path.open("rb")
            start, size = self._stream.read(len(MAGIC)), path.stat().st_size
            self._stream.seek(-min(size, len(MAGIC)), 2)
            end = self._stream.read()
        except OSError as error:
            raise CameraError(f"{path}: cannot be read ({error.strerror})") from None
        if start != MAGIC:
            self.close()
            raise CameraError(f"{path}: not an MCAP recording ({size} bytes)")
        self.whole = end == MAGIC and size > 2 * len(MAGIC)
        self.topics: dict[str, Topic] = {}
        self.metadata: dict[str, dict[str, str]] = {}
        self.attachments: dict[str, bytes] = {}
        self._decoders = DecoderFactory()
        try:
            self._reader = self._indexed_reader() if self.whole else None
            if self._reader is None:
                self._scan()
        except CameraError:
            self.close()
            raise

    def messages(self, topic: str) -> Iterator[tuple[int, Callable[[], Any]]]:
        """(log time in ns, decode) for each message of a topic, in order; `decode()` gives its fields as attributes.

        Raises CameraError at damage, and at a message that is not CDR with a `ros2msg` definition.
        """
        for schema, channel, message in self._guarded(self._raw(topic)):
            decoder = self._guarded_call(self._decoders.decoder_for, channel.message_encoding, schema)
            if decoder is None:
                how = f"{channel.message_encoding or 'unnamed'}/{schema.encoding if schema else 'no schema'}"
                raise CameraError(f"{self.path}: {topic} is encoded as {how}, edgemap reads cdr/ros2msg")

            def decode(decoder: Any = decoder, data: bytes = message.data) -> Any:
                return self._guarded_call(decoder, data)

            yield message.log_time, decode

    def close(self) -> None:
        """Close the file."""
        self._stream.close()

    def _raw(self, topic: str) -> Iterator[tuple[Any, Any, Any]]:
        if self._reader is not None:
            yield from self._reader.iter_messages(topics=[topic])
            return
        for schema, channel, message in self._sequential():
            if channel.topic == topic:
                yield schema, channel, message

    def _indexed_reader(self) -> Any:
        """mcap's reader where the file has an index of its chunks, topics and counts; else None."""
        from mcap.reader import SeekingReader

        self._stream.seek(0)
        reader = SeekingReader(self._stream, validate_crcs=True, record_size_limit=RECORD_LIMIT_BYTES)
        summary = self._guarded_call(reader.get_summary)
        if summary is None or not summary.chunk_indexes or summary.statistics is None:
            return None
        for chunk in summary.chunk_indexes:
            if chunk.compression not in COMPRESSIONS:
                raise CameraError(f"{self.path}: chunks compressed with {chunk.compression!r}, edgemap reads lz4, zstd")
        for channel in summary.channels.values():
            topic = self._topic(channel, summary.schemas.get(channel.schema_id))
            topic.count += summary.statistics.channel_message_counts.get(channel.id, 0)
        self.metadata = {found.name: found.metadata for found in self._guarded(reader.iter_metadata())}
        self.attachments = {found.name: found.data for found in self._guarded(reader.iter_attachments())}
        return reader

    def _scan(self) -> None:
        """Topics and their counts of a file without index, by reading it through."""
        for schema, channel, _ in self._guarded(self._sequential()):
            self._topic(channel, schema).count += 1

    def _topic(self, channel: Any, schema: Any) -> Topic:
        if channel.topic not in self.topics:
            kind = schema.name.replace("/msg/", "/") if schema else ""
            self.topics[channel.topic] = Topic(kind, channel.message_encoding)
        return self.topics[channel.topic]

    def _sequential(self) -> Iterator[tuple[Any, Any, Any]]:
        """Messages in the file's own order; metadata and attachments on the way are kept."""
        from mcap.records import Attachment, Channel, Message, Metadata, Schema
        from mcap.stream_reader import StreamReader

        schemas: dict[int, Any] = {}
        channels: dict[int, Any] = {}
        self._stream.seek(0)
        records: Any = StreamReader(self._stream, validate_crcs=True, record_size_limit=RECORD_LIMIT_BYTES).records
        for record in records if self.whole else self._up_to_the_cut(records):
            if isinstance(record, Schema):
                schemas[record.id] = record
            elif isinstance(record, Channel):
                channels[record.id] = record
            elif isinstance(record, Message):
                channel = channels[record.channel_id]
                yield schemas.get(channel.schema_id), channel, record
            elif isinstance(record, Metadata):
                self.metadata[record.name] = record.metadata
            elif isinstance(record, Attachment):
                self.attachments[record.name] = record.data

    def _up_to_the_cut(self, records: Iterator[Any]) -> Iterator[Any]:
        try:
            yield from records
        except _damage():
            return

    def _guarded(self, items: Iterator[Any]) -> Iterator[Any]:
        try:
            yield from items
        except _damage() as error:
            raise CameraError(f"{self.path}: damaged recording ({_what(error)})") from None

    def _guarded_call(self, function: Callable[..., Any], *arguments: Any) -> Any:
        try:
            return function(*arguments)
        except _damage() as error:
            raise CameraError(f"{self.path}: damaged recording ({_what(error)})") from None


def _damage() -> tuple[type[Exception], ...]:
    """What mcap, lz4 and zstandard raise at bytes that are not what they should be."""
    from mcap.exceptions import McapError
    from zstandard import ZstdError

    return (McapError, ZstdError, struct.error, ValueError, KeyError, IndexError, RuntimeError, OSError)


def _what(error: Exception) -> str:
    return " ".join(f"{type(error).__name__} {error}".split())[:160]
