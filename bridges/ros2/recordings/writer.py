"""Writes a recording: a chunked MCAP file that is valid up to its last complete chunk at any moment."""

from pathlib import Path
from typing import Any

from edgemap.bridges.ros2.messages.definitions import Message, definition, encoder
from edgemap.runtime.frames.disk import append
from edgemap.runtime.frames.errors import DiskError, RecordingError
from edgemap.runtime.frames.extras import need
from edgemap.runtime.frames.version import VERSION

CHUNK_BYTES = 1 << 19  # what a killed process loses at most; half a MiB is a few pictures


class McapFile:
    """ROS 2 messages into one MCAP file, CDR-encoded, definitions embedded.

    Chunks are not compressed: pictures are already, and any reader supports that. A full chunk is handed to the
    operating system at once, completely or not at all. A chunk that the disk cannot take waits in memory; until it is
    written, new messages are dropped, and later ones continue in the same file.
    Raises RecordingError where the file exists, DiskError where the disk cannot be written.
    """

    def __init__(self, path: Path) -> None:
        need("record", "a recording")
        from mcap.writer import CompressionType, Writer

        self.path = path
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.open("xb").close()
        except FileExistsError:
            raise RecordingError(f"{path} exists already; choose another file") from None
        except OSError as error:
            raise DiskError(f"{path}: cannot be written ({error.strerror})") from None
        self._stream: Any = _Chunks(path)
        self._writer = Writer(self._stream, chunk_size=CHUNK_BYTES, compression=CompressionType.NONE)
        self._writer.start(profile="ros2", library=f"edgemap {VERSION}")
        self._open = True
        self._schemas: dict[str, int] = {}
        self._channels: dict[str, int] = {}
        self._counts: dict[str, int] = {}

    def write(self, topic: str, kind: str, stamp_ns: int, message: Message) -> None:
        """Append a message of a ROS 2 type (`sensor_msgs/msg/CameraInfo`) at a stamp."""
        channel = self._channels.get(topic)
        if channel is None:
            if kind not in self._schemas:
                text = definition(kind).encode()
                self._schemas[kind] = self._writer.register_schema(kind, "ros2msg", text)
            channel = self._channels[topic] = self._writer.register_channel(topic, "cdr", self._schemas[kind])
        number = self._counts[topic] = self._counts.get(topic, 0) + 1
        data = encoder(kind)(message)
        self._written(self._writer.add_message, channel, stamp_ns, data, stamp_ns, number)

    def metadata(self, name: str, record: dict[str, str]) -> None:
        """Append a metadata record."""
        self._written(self._writer.add_metadata, name, record)

    def attach(self, name: str, media_type: str, data: bytes) -> None:
        """Append a file."""
        self._written(self._writer.add_attachment, 0, 0, name, media_type, data)

    def close(self) -> None:
        """Write index and end; may be called twice."""
        if self._open:
            try:
                self._written(self._writer.finish)
            finally:
                self._open = False

    def _written(self, write: Any, *arguments: Any, **options: Any) -> None:
        if not self._open:
            raise RecordingError(f"{self.path}: recording is closed")
        self._stream.flush()  # what waits since the disk did not take it
        write(*arguments, **options)
        self._stream.flush()  # nothing where the chunk is not full


class _Chunks:
    """What the MCAP library writes to: bytes wait in memory until `flush` appends them to the file."""

    def __init__(self, path: Path) -> None:
        self._path, self._waiting, self._end = path, bytearray(), 0

    def write(self, data: bytes) -> int:
        self._waiting += data
        self._end += len(data)
        return len(data)

    def tell(self) -> int:
        return self._end

    def flush(self) -> None:
        """Raises DiskError; pending data stays pending then."""
        if self._waiting:
            append(self._path, bytes(self._waiting), create=False)
            self._waiting.clear()
