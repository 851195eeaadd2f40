"""Reads any MCAP file of ROS 2 messages, complete or truncated: its topics, and messages in order of time."""

import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from zlib import crc32

from edgemap.bridges.ros2.messages.definitions import FIELDS, decoder
from edgemap.bridges.ros2.recordings.chunks import (
    MAGIC,
    Definitions,
    Summary,
    messages_by_time,
    read_summary,
    records,
    unpacked,
)
from edgemap.bridges.ros2.recordings.facts import RECORD, TRUTH_FILE, WHEEL_FILE
from edgemap.runtime.frames.errors import CameraError
from edgemap.runtime.frames.extras import need
from edgemap.runtime.frames.reading import one_line

OWN_FILES = (WHEEL_FILE, TRUTH_FILE)
PICTURES = ("sensor_msgs/Image", "sensor_msgs/CompressedImage")
MESSAGE_BYTES = 256 << 10  # of other kinds, whose many small values take many times their size


@dataclass(slots=True)
class Topic:
    """One topic: ROS 2 type in its short form (`sensor_msgs/Image`), and messages read or announced."""

    kind: str
    count: int = 0


class McapReading:
    """An open MCAP file. whole: whether the file is complete; a truncated one is readable up to the cut.

    topics: by name. metadata, attachments: edgemap's own, by name. Messages are decoded by ROS's own definitions of the
    kinds that edgemap knows, never by a definition in the file.
    Raises CameraError, one line, for files that are not MCAP, and for damage inside a complete one.
    """

    def __init__(self, path: Path) -> None:
        need("record", "a recording")
        self.path = path
        try:
            if not path.is_file():  # a pipe would block
                raise CameraError(f"{path}: no such file")
            stream = path.open("rb")
            start, size = stream.read(len(MAGIC)), path.stat().st_size
            stream.seek(-min(size, len(MAGIC)), 2)
            end = stream.read(len(MAGIC))
        except OSError as error:
            raise CameraError(f"{path}: cannot be read ({error.strerror})") from None
        self._stream, self._size = stream, size
        if start != MAGIC:
            self.close()
            raise CameraError(f"{path}: not an MCAP recording ({size} bytes)")
        self.complete = end == MAGIC and size > 2 * len(MAGIC)
        self.topics: dict[str, Topic] = {}
        self.metadata: dict[str, dict[str, str]] = {}
        self.attachments: dict[str, bytes] = {}
        self._summary: Summary | None = None
        try:
            self._summary = self._guarded_call(self._indexed) if self.complete else None
            if self._summary is None:
                self._scan()
        except CameraError:
            self.close()
            raise

    def topics_of(self, *kinds: str) -> list[str]:
        """The topics of these kinds that have messages, in the file's order."""
        return [name for name, topic in self.topics.items() if topic.kind in kinds and topic.count]

    def messages(self, topic: str) -> Iterator[tuple[int, Callable[[], Any]]]:
        """(log time in ns, decode) for each message of a topic, in order; `decode()` gives its fields as attributes.

        Raises CameraError at damage, and at a message that is not CDR with a `ros2msg` definition.
        """
        for schema, channel, message in self._guarded(self._raw(topic)):
            decoder = self._guarded_call(self._decoder, topic, schema, channel)
            if len(message.data) > MESSAGE_BYTES and _short(schema.name) not in PICTURES:
                raise CameraError(
                    f"{self.path}: {topic} has a message of {len(message.data):,} bytes, "
                    f"at most {MESSAGE_BYTES:,} are read"
                )

            def decode(decoder: Any = decoder, data: bytes = message.data) -> Any:
                return self._guarded_call(decoder, data)

            yield message.log_time, decode

    def _decoder(self, topic: str, schema: Any, channel: Any) -> Callable[[bytes], Any]:
        if channel.message_encoding != "cdr" or schema is None or schema.encoding != "ros2msg":
            how = f"{channel.message_encoding or 'unnamed'}/{schema.encoding if schema else 'no schema'}"
            raise CameraError(f"{self.path}: {topic} is encoded as {one_line(how)}, edgemap reads cdr/ros2msg")
        kind = _short(schema.name)
        if kind not in FIELDS:
            raise CameraError(f"{self.path}: {topic} is {one_line(kind)}, a kind that edgemap does not read")
        if kind != self.topics[topic].kind:
            raise CameraError(f"{self.path}: {topic} is {self.topics[topic].kind} and {kind}; a topic has one kind")
        return decoder(kind)

    def close(self) -> None:
        """Close the file."""
        self._stream.close()

    def _raw(self, topic: str) -> Iterator[tuple[Any, Any, Any]]:
        if self._summary is None:
            for schema, channel, message in self._sequential():
                if channel.topic == topic:
                    yield schema, channel, message
            return
        schemas, channels = self._summary.definitions.schemas, self._summary.definitions.channels
        wanted = {number: channel for number, channel in channels.items() if channel.topic == topic}
        for message in messages_by_time(self._stream, self._summary.chunks, wanted):
            channel = wanted[message.channel_id]
            yield schemas.get(channel.schema_id), channel, message

    def _indexed(self) -> Summary | None:
        """The summary where the file has an index of its chunks, topics and counts; else None."""
        summary = read_summary(self._stream, self._size)
        if summary is None or not summary.chunks or summary.statistics is None:
            return None
        for channel in summary.definitions.channels.values():
            topic = self._topic(channel, summary.definitions.schemas.get(channel.schema_id))
            topic.count += summary.statistics.channel_message_counts.get(channel.id, 0)
        for index in (*summary.metadata, *summary.attachments):
            if index.name in (RECORD, *OWN_FILES):
                self._stream.seek(index.offset)
                self._keep(next(records(self._stream), None))
        return summary

    def _scan(self) -> None:
        """Topics and their counts of a file without index, by reading it through."""
        for schema, channel, _ in self._guarded(self._sequential()):
            self._topic(channel, schema).count += 1

    def _topic(self, channel: Any, schema: Any) -> Topic:
        if channel.topic not in self.topics:
            self.topics[channel.topic] = Topic(_short(schema.name) if schema else "")
        return self.topics[channel.topic]

    def _sequential(self) -> Iterator[tuple[Any, Any, Any]]:
        """Messages in the file's own order; metadata and attachments on the way are kept."""
        with self.path.open("rb") as stream:  # of its own: pictures and depth are read in turn
            stream.seek(len(MAGIC))
            yield from self._messages_of(records(stream, crc32(MAGIC)))

    def _messages_of(self, found: Iterator[Any]) -> Iterator[tuple[Any, Any, Any]]:
        from mcap.records import Chunk, Message

        known = Definitions()
        all_records = (
            inner for record in found for inner in (unpacked(record) if isinstance(record, Chunk) else [record])
        )
        for record in all_records if self.complete else self._up_to_the_cut(all_records):
            if isinstance(record, Message):
                channel = known.channels[record.channel_id]
                yield known.schemas.get(channel.schema_id), channel, record
            else:
                known.add(record)
                self._keep(record)

    def _keep(self, record: Any) -> None:
        """Remember metadata and attachments of edgemap's own."""
        from mcap.records import Attachment, Metadata

        if isinstance(record, Metadata) and record.name == RECORD:
            self.metadata[record.name] = record.metadata
        elif isinstance(record, Attachment) and record.name in OWN_FILES:
            self.attachments[record.name] = record.data

    def _up_to_the_cut(self, records: Iterator[Any]) -> Iterator[Any]:
        damage = _damage()  # asked for now: at the interpreter's end nothing can be imported
        try:
            yield from records
        except damage:
            return

    def _guarded(self, items: Iterator[Any]) -> Iterator[Any]:
        damage = _damage()
        try:
            yield from items
        except damage as error:
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

    bytes_of_no_message = (
        struct.error,
        ValueError,
        LookupError,
        RuntimeError,
        OverflowError,
        NotImplementedError,
        EOFError,
    )
    return (McapError, ZstdError, *bytes_of_no_message, OSError)


def _what(error: Exception) -> str:
    return one_line(f"{type(error).__name__} {error}")


def _short(kind: str) -> str:
    """ROS's `sensor_msgs/msg/Image` as `sensor_msgs/Image`."""
    return kind.replace("/msg/", "/")
