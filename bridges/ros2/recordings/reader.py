"""Reads any MCAP file of ROS 2 messages, complete or cut off: its topics, and messages in order of time."""

from collections.abc import Iterator
from contextlib import ExitStack, closing, contextmanager
from io import SEEK_END
from itertools import islice
from pathlib import Path
from typing import Any

from edgemap.bridges.ros2.messages.definitions import DAMAGE
from edgemap.bridges.ros2.recordings.facts import RECORD, TRUTH_FILE, WHEEL_FILE
from edgemap.bridges.ros2.recordings.reading import (
    Reading,
    SplitReading,
    SqliteReading,
    Topic,
    decoded,
    short,
)
from edgemap.runtime.frames.errors import CameraError
from edgemap.runtime.frames.extras import need
from edgemap.runtime.frames.reading import one_line
from edgemap.runtime.inputs.drives.pictures import natural_key

MAGIC = b"\x89MCAP0\r\n"


class McapReading(Reading):
    """An open MCAP file, read to its last complete chunk where it was cut off. Messages are decoded by ROS's own
    definitions of the kinds that edgemap knows, never by a definition in the file.
    Raises CameraError, one line, for files that are not MCAP, and for damage inside a complete one.
    """

    def __init__(self, path: Path) -> None:
        need("record", "a recording")
        super().__init__(path)
        if not path.is_file():  # a pipe would block
            raise CameraError(f"{path}: no such file")
        try:
            with path.open("rb") as stream:
                start, size = stream.read(len(MAGIC)), path.stat().st_size
                stream.seek(-min(size, len(MAGIC)), SEEK_END)
                end = stream.read(len(MAGIC))
        except OSError as error:
            raise CameraError(f"{path}: cannot be read ({error.strerror})") from None
        if start != MAGIC:
            raise CameraError(f"{path}: not an MCAP recording ({size} bytes)")
        self.complete = end == MAGIC and size > 2 * len(MAGIC)
        with self._guarded():
            if not (self.complete and self._read_summary()):
                self._scan()

    def messages(self, topic: str) -> Iterator[tuple[int, Any]]:
        """Those of a topic. Raises CameraError at damage, and at one that is not CDR with a `ros2msg` definition."""
        from mcap.reader import NonSeekingReader

        # A stream for each topic: pictures and depth are read in turn. In the order of the file: by an index it would
        # be that of log times, which a clock that was set mixes up.
        with self._guarded(), self.path.open("rb") as stream:
            every = NonSeekingReader(stream, validate_crcs=True).iter_messages(topic, log_time_order=False)
            count = self.topics[topic].count  # the rest of a large file has none
            for schema, channel, message in islice(every, count):
                kind = self._kind(topic, schema, channel)
                yield message.log_time, decoded(self.path, topic, kind, message.data)

    def _kind(self, topic: str, schema: Any, channel: Any) -> str:
        if channel.message_encoding != "cdr" or schema is None or schema.encoding != "ros2msg":
            how = f"{channel.message_encoding or 'unnamed'}/{schema.encoding if schema else 'no schema'}"
            raise CameraError(f"{self.path}: {topic} is encoded as {one_line(how)}, edgemap reads cdr/ros2msg")
        kind, first = short(schema.name), self.topics[topic].kind
        if kind != first:
            raise CameraError(f"{self.path}: {topic} is {first} and {one_line(kind)}; a topic has one kind")
        return kind

    def _read_summary(self) -> bool:
        """Topics and their counts, metadata and attachments by the file's index. Returns whether it has one."""
        from mcap.reader import SeekingReader

        with self.path.open("rb") as stream:
            reader = SeekingReader(stream, validate_crcs=True)
            summary = reader.get_summary()
            if summary is None or not summary.chunk_indexes or summary.statistics is None:
                return False
            for channel in summary.channels.values():
                counts = summary.statistics.channel_message_counts
                self._topic(channel, summary.schemas).count += counts.get(channel.id, 0)
            for record in (*reader.iter_metadata(), *reader.iter_attachments()):
                self._keep(record)
        return True

    def _scan(self) -> None:
        """Reads a file without index through: topics and their counts, metadata, attachments."""
        from mcap.records import Channel, Message, Schema
        from mcap.stream_reader import StreamReader

        schemas: dict[int, Any] = {}
        channels: dict[int, Any] = {}
        with self.path.open("rb") as stream:
            for record in StreamReader(stream, validate_crcs=True).records:
                if isinstance(record, Schema):
                    schemas[record.id] = record
                elif isinstance(record, Channel):
                    channels[record.id] = record
                elif isinstance(record, Message):
                    self._topic(channels[record.channel_id], schemas).count += 1
                else:
                    self._keep(record)

    def _topic(self, channel: Any, schemas: dict[int, Any]) -> Topic:
        if not channel.topic.isprintable():
            raise ValueError(f"a topic's name does not print: {channel.topic[:40]!a}")
        if channel.topic not in self.topics:
            kind = schemas[channel.schema_id].name if channel.schema_id else ""
            self.topics[channel.topic] = Topic(one_line(short(kind)))
        return self.topics[channel.topic]

    def _keep(self, record: Any) -> None:
        """Keeps edgemap's metadata and attachments."""
        from mcap.records import Attachment, Metadata

        if isinstance(record, Metadata) and record.name == RECORD:
            self.metadata[record.name] = record.metadata
        elif isinstance(record, Attachment) and record.name in (WHEEL_FILE, TRUTH_FILE):
            self.attachments[record.name] = record.data

    @contextmanager
    def _guarded(self) -> Iterator[None]:
        """Raises CameraError for damage; in a file that was cut off the block ends there instead."""
        from mcap.exceptions import McapError  # before it is needed: at the interpreter's end nothing can be imported
        from zstandard import ZstdError

        try:
            yield
        except (McapError, ZstdError, *DAMAGE, OSError) as error:
            if not self.complete:
                return
            what = one_line(f"{type(error).__name__} {error}")
            raise CameraError(f"{self.path}: damaged recording ({what})") from None


def open_reading(path: Path) -> Reading:
    """A recording by its name: MCAP, `.db3`, or the folder of a bag with such files, split or not. Raises
    CameraError."""
    if path.is_dir():
        files = sorted((file for file in path.iterdir() if file.suffix in (".mcap", ".db3")), key=natural_key)
        packed = next(path.glob("*.zstd"), None)
        if not files:
            what = f"{packed.name} is compressed: `zstd -d` it first" if packed else "no .mcap and no .db3 in it"
            raise CameraError(f"{path}: {what}")
        with ExitStack() as opened:
            parts = [opened.enter_context(closing(open_reading(file))) for file in files]
            opened.pop_all()
        return SplitReading(path, parts) if len(parts) > 1 else parts[0]
    if path.suffix == ".bag":
        from edgemap.bridges.ros2.recordings.ros1 import Ros1Reading

        return Ros1Reading(path)
    return SqliteReading(path) if path.suffix == ".db3" and path.is_file() else McapReading(path)
