"""An open recording of ROS messages, whatever its container: topics, and messages in order of time."""

import sqlite3
from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from itertools import chain, islice
from pathlib import Path
from typing import Any

from edgemap.bridges.ros2.messages.definitions import DAMAGE, FIELDS, decoder, ns_of, to_s
from edgemap.runtime.frames.errors import CameraError
from edgemap.runtime.frames.faults import FaultKind, note
from edgemap.runtime.frames.reading import one_line
from edgemap.runtime.frames.stamps import AGREEING, followed


@dataclass(slots=True)
class Topic:
    """One topic: ROS 2 type in its short form (`sensor_msgs/Image`), and messages read or announced."""

    kind: str
    count: int = 0


class Reading:
    """An open recording. complete: whether it has its end; else it is read to its last complete part.

    topics: by name. metadata, attachments: edgemap's, by name.
    """

    def __init__(self, path: Path) -> None:
        self.path, self.complete = path, True
        self.topics: dict[str, Topic] = {}
        self.metadata: dict[str, dict[str, str]] = {}
        self.attachments: dict[str, bytes] = {}

    def topics_of(self, *kinds: str) -> list[str]:
        """The topics of these kinds that have messages, in the file's order."""
        return [name for name, topic in self.topics.items() if topic.kind in kinds and topic.count]

    def messages(self, topic: str) -> Iterator[tuple[int, Any]]:
        """(log time in ns, message) of a topic, in the order of the file; a message has its fields as attributes.

        Raises CameraError at damage, and at a message that is not CDR of a kind that edgemap reads.
        """
        raise NotImplementedError

    def first(self, topic: str) -> Any:
        """The first message of a topic. Raises CameraError."""
        for _, message in self.messages(topic):
            return message
        raise CameraError(f"{self.path}: {topic} has no message")

    def samples(self, topic: str) -> Iterator[tuple[int | None, int, Any, str]]:
        """(stamp in ns, header's stamp, message, fault) as `followed` has it, by the headers' stamps, or the log times
        where no header has one: two clocks never mix. A zero stamp among others is dropped. The first fault says where
        log times are taken. Raises CameraError."""
        by_log = not self.metadata  # edgemap's stamps may begin at zero
        with suppress(CameraError):  # which is raised below, behind the messages before it
            by_log = by_log and not any(
                ns_of(message.header.stamp) for _, message in islice(self.messages(topic), AGREEING)
            )
        unstamped = "its headers have no stamps, the times of recording are taken" if by_log else ""
        rows = self.messages(topic)
        stamped = ((log_ns if by_log else ns_of(message.header.stamp), log_ns, message) for log_ns, message in rows)
        timed = ((max(row[0], -1), row) for row in stamped)
        for stamp_ns, (own_ns, _, message), fault in followed(timed, 10**9, lambda row: row[1]):
            if stamp_ns is not None:
                fault, unstamped = fault or unstamped, ""
            yield None if stamp_ns is None else int(stamp_ns), own_ns, message, fault

    def sound(self, topic: str, dropped: list[str]) -> Iterator[tuple[float, Any]]:
        """(stamp in s, message) of the samples that are not dropped; a clock that was set is reported. dropped: gets
        why each of the others is. Raises CameraError."""
        for stamp_ns, _, message, fault in self.samples(topic):
            if stamp_ns is None:
                dropped.append(fault)
                continue
            if fault:
                note(FaultKind.SAMPLES, f"{self.path}: {topic}: {fault}")
            yield to_s(stamp_ns), message

    def close(self) -> None:
        """Closes the file."""


class SplitReading(Reading):
    """The parts of a bag that was split, in order."""

    def __init__(self, path: Path, parts: Iterable[Reading]) -> None:
        super().__init__(path)
        self._parts = list(parts)
        for part in self._parts:
            self.metadata, self.attachments = part.metadata | self.metadata, part.attachments | self.attachments
            for name, topic in part.topics.items():
                self.topics.setdefault(name, Topic(topic.kind)).count += topic.count
        self.complete = all(part.complete for part in self._parts)

    def messages(self, topic: str) -> Iterator[tuple[int, Any]]:
        """Those of each part in turn."""
        return chain.from_iterable(part.messages(topic) for part in self._parts if topic in part.topics)

    def close(self) -> None:
        """Closes all parts."""
        for part in self._parts:
            part.close()


class SqliteReading(Reading):
    """A bag of ROS 2 in SQLite, `FILE.db3`. Raises CameraError for a file that is none."""

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        try:
            self._file = sqlite3.connect(f"{path.absolute().as_uri()}?mode=ro", uri=True)
            counts = dict(self._file.execute("SELECT topic_id, COUNT(*) FROM messages GROUP BY topic_id"))
            rows = self._file.execute("SELECT id, name, type, serialization_format FROM topics ORDER BY id").fetchall()
        except sqlite3.Error as error:
            raise CameraError(f"{path}: no bag of ROS 2 in SQLite ({one_line(error)})") from None
        self._ids: dict[str, int] = {}
        for number, name, kind, coding in rows:
            if coding == "cdr" and str(name).isprintable():
                self._ids[str(name)] = number
                self.topics[str(name)] = Topic(one_line(short(str(kind))), counts.get(number, 0))
        if any(name.startswith("/device_0/") for name in self.topics):
            self.close()
            raise CameraError(f"{path}: a recording of librealsense; pass realsense:{path}")

    def messages(self, topic: str) -> Iterator[tuple[int, Any]]:
        """Those of a topic as they were written."""
        asked = "SELECT timestamp, data FROM messages WHERE topic_id = ? ORDER BY id"
        try:
            for log_ns, data in self._file.execute(asked, (self._ids[topic],)):
                yield int(log_ns), decoded(self.path, topic, self.topics[topic].kind, bytes(data))
        except (sqlite3.Error, ValueError, TypeError) as error:
            raise CameraError(f"{self.path}: damaged recording ({one_line(error)})") from None

    def close(self) -> None:
        """Closes the file."""
        with suppress(sqlite3.Error):
            self._file.close()


def decoded(path: Path, topic: str, kind: str, data: bytes) -> Any:
    """A message of a kind in its short form from CDR. Raises CameraError."""
    if kind not in FIELDS:
        raise CameraError(f"{path}: {topic} is {one_line(kind)}, a kind that edgemap does not read")
    try:
        return decoder(kind)(data)
    except DAMAGE as error:
        raise CameraError(f"{path}: damaged recording ({one_line(error)})") from None


def short(kind: str) -> str:
    """ROS's `sensor_msgs/msg/Image` as `sensor_msgs/Image`."""
    return kind.replace("/msg/", "/")
