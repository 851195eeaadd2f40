"""Records pictures with intrinsics, mount, wheel odometry and truth, and, as a sink, a run's results."""

from collections import Counter, deque
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import replace
from operator import itemgetter
from pathlib import Path
from typing import Any

from edgemap.bridges.ros2.messages import build, topics
from edgemap.bridges.ros2.messages.definitions import Message, definition, encoder, to_ns, to_s
from edgemap.bridges.ros2.messages.stream import MessageStream, Outgoing
from edgemap.bridges.ros2.messages.topics import IDS, FrameIds, Topic
from edgemap.bridges.ros2.recordings.facts import RECORD, TRUTH_FILE, WHEEL_FILE, facts_record, trajectory_file
from edgemap.bridges.ros2.recordings.pictures import encoded_depth
from edgemap.geometry.map_object import MapObject
from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.camera import CameraInfo
from edgemap.runtime.frames.disk import append
from edgemap.runtime.frames.errors import BridgeError, DiskError
from edgemap.runtime.frames.extras import need
from edgemap.runtime.frames.frame import Frame
from edgemap.runtime.frames.trajectory import Trajectory
from edgemap.runtime.frames.version import VERSION
from edgemap.runtime.outputs.sinks.kinds import RunInfo
from edgemap.runtime.step.sinks import Sink
from edgemap.runtime.step.slam import StepResult

CHUNK_BYTES = 1 << 19  # what a killed process loses at most; half a MiB is a few pictures
TRUTH_IDS = FrameIds(odom=IDS.map)  # true poses start where the map does, and never jump


class McapFile:
    """ROS 2 messages into one MCAP file, CDR-encoded, definitions embedded.

    Chunks are not compressed: pictures are already, and any reader supports that. A full chunk is handed to the
    operating system at once, completely or not at all. A chunk that the disk cannot take waits in memory; until it is
    written, new messages are dropped, and later ones continue in the same file.
    Raises BridgeError where the file exists, DiskError where the disk cannot be written.
    """

    def __init__(self, path: Path, record: dict[str, str], attachments: dict[str, bytes]) -> None:
        """record: edgemap's metadata. attachments: JSON files, by name."""
        need("record", "a recording")
        from mcap.writer import CompressionType, Writer

        self.path = path
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.open("xb").close()
        except FileExistsError:
            raise BridgeError(f"{path} exists already; choose another file") from None
        except OSError as error:
            raise DiskError(f"{path}: cannot be written ({error.strerror})") from None
        self._stream: Any = _Chunks(path)
        self._writer = Writer(self._stream, chunk_size=CHUNK_BYTES, compression=CompressionType.NONE)
        self._writer.start(profile="ros2", library=f"edgemap {VERSION}")
        self._open = True
        self._schemas: dict[str, int] = {}
        self._channels: dict[str, int] = {}
        self._counts = Counter[str]()  # messages by topic
        self._written(self._writer.add_metadata, RECORD, record)
        for name, data in attachments.items():
            self._written(self._writer.add_attachment, 0, 0, name, "application/json", data)

    def write(self, topic: Topic, stamp_ns: int, message: Message) -> None:
        """Append a message at a stamp."""
        channel, kind = self._channels.get(topic), topic.kind
        if channel is None:
            if kind not in self._schemas:
                text = definition(kind).encode()
                self._schemas[kind] = self._writer.register_schema(kind, "ros2msg", text)
            channel = self._channels[topic] = self._writer.register_channel(topic, "cdr", self._schemas[kind])
        self._counts[topic] += 1
        data = encoder(kind)(message)
        self._written(self._writer.add_message, channel, stamp_ns, data, stamp_ns, self._counts[topic])

    def close(self) -> None:
        """Write index and end; may be called twice."""
        if self._open:
            try:
                self._written(self._writer.finish)
            finally:
                self._open = False

    def _written(self, write: Any, *arguments: Any, **options: Any) -> None:
        if not self._open:
            raise BridgeError(f"{self.path}: recording is closed")
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


class Recorder(Sink):
    """Frames, and as a sink a run's results, into an MCAP file. lossless: PNG instead of JPEG.

    info: the camera, with wheel odometry and truth where those are recorded. Poses that come live are left out. Raises
    BridgeError, or DiskError where the disk cannot be written: those results are missing, and later ones continue in
    the same file.
    """

    def __init__(self, path: Path, info: CameraInfo, *, lossless: bool = False) -> None:
        self.path, self.name, self.frames = path, f"recording {path.name}", 0
        self._stream = MessageStream(info.intrinsics, info.mount, lossless=lossless)
        rows, attachments = list[tuple[int, Topic, SE2, FrameIds]](), dict[str, bytes]()
        for topic, name, track, ids in (
            (topics.WHEEL, WHEEL_FILE, info.wheel, IDS),
            (topics.TRUTH, TRUTH_FILE, info.truth, TRUTH_IDS),
        ):
            if isinstance(track, Trajectory):
                attachments[name] = trajectory_file(track)
                timed = zip(track.stamps_s.tolist(), track.poses, strict=True)
                rows += [(to_ns(at_s), topic, pose, ids) for at_s, pose in timed if 0.0 <= at_s < 2**31]  # ROS time
        self._file = McapFile(path, facts_record(info), attachments)
        self._poses = deque(sorted(rows, key=itemgetter(0)))  # that are to be written, between the pictures
        self._last: tuple[int, list[MapObject], SE2] | None = None
        self._map_ns: int | None = None  # stamp of the newest map in the file

    def picture(self, frame: Frame) -> int:
        """Records a frame with intrinsics, mount and the wheel odometry up to it. Returns its stamp in nanoseconds."""
        stamp_ns = to_ns(frame.stamp_s)
        while self._poses and self._poses[0][0] <= stamp_ns:
            at_ns, topic, pose, ids = self._poses.popleft()
            self._file.write(topic, at_ns, build.odometry(at_ns, pose, ids=ids))
        if to_s(stamp_ns) != frame.stamp_s:  # finer than a nanosecond: the replay shall have it all the same
            self._file.write(topics.STAMPS, stamp_ns, {"data": frame.stamp_s})
        if not frame.search:
            self._file.write(topics.SEARCHED, stamp_ns, {"data": 0.0})
        samples = frame.imu
        for at_s, gyro, accel in zip(samples.stamps_s, samples.gyro_rad_s, samples.accel_m_s2, strict=True):
            if at_s < 0.0:
                continue  # before a stream that starts at zero: no ROS time
            at_ns = to_ns(float(at_s))
            self._file.write(topics.IMU, at_ns, build.imu(at_ns, gyro.tolist(), accel.tolist()))
        if frame.depth is not None:
            self._file.write(topics.DEPTH, stamp_ns, build.compressed_image(stamp_ns, *encoded_depth(frame.depth)))
        self._write(self._stream.picture(frame))
        self.frames += 1
        return stamp_ns

    def write(self, result: StepResult, objects: list[MapObject]) -> None:
        """Record one step: its picture, poses, boxes, and every few frames the map."""
        self._last = (self.picture(result.frame), objects, result.pose_map_base)
        self._write(self._stream.results(result, objects))

    def last(self, result: StepResult, objects: list[MapObject]) -> None:
        """Records the boxes that came after the last frame, and the map with them."""
        self._write(self._stream.last(result, objects))

    def edit(self, line: str) -> None:
        """Record an edit, as a line of edits.jsonl, at the picture before it. One that the disk does not take, or that
        comes after the end of the file, is missing in a replay."""
        stamp_ns = self._last[0] if self._last is not None else 0
        with suppress(DiskError, BridgeError):
            self._file.write(topics.EDITS, stamp_ns, {"data": line})

    def close(self) -> None:
        """The last map, where it is newer than the one recorded, and the file's end; may be called twice. Without its
        end the file is valid up to its last complete chunk."""
        try:
            if self._last is not None and self._last[0] != self._map_ns:
                self._write(self._stream.map(*self._last))
        finally:
            self._file.close()

    def _write(self, messages: Iterable[Outgoing]) -> None:
        for outgoing in messages:
            if outgoing.topic == topics.OBJECTS:
                self._map_ns = outgoing.stamp_ns
            if outgoing.topic not in (topics.GRID, topics.FLOOR_SCAN):  # these follow from the objects and the pictures
                self._file.write(outgoing.topic, outgoing.stamp_ns, outgoing.make())


def file_of(text: str) -> tuple[Path, bool]:
    """The file in `[lossless:]FILE.mcap`, and whether its pictures are lossless."""
    name = text.removeprefix("lossless:")
    return Path(name), name != text


def open(address: str, run: RunInfo) -> Recorder:
    """The sink of `--record [lossless:]FILE.mcap`, with lens, mount, inference, guess, wheels and edits of the run.

    Raises BridgeError, DiskError or CameraError.
    """
    floor, guess = run.floor, run.guess or {}
    info = replace(
        run.camera.info, intrinsics=floor.intrinsics, mount=floor.mount, inference=run.inference, calibration=guess
    )
    path, lossless = file_of(address)
    sink = Recorder(path, info, lossless=lossless)
    run.edits.recorders.append(sink.edit)
    return sink
