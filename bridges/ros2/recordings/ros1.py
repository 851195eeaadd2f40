"""Bags of ROS 1, `FILE.bag`, through rosbags: their messages have ROS 2's field names here."""

from collections.abc import Iterator
from dataclasses import fields
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from edgemap.bridges.ros2.messages.definitions import FIELDS
from edgemap.bridges.ros2.recordings.reading import Reading, Topic, short
from edgemap.runtime.frames.errors import CameraError
from edgemap.runtime.frames.extras import need
from edgemap.runtime.frames.reading import one_line

RENAMED = {"tf/msg/tfMessage": "tf2_msgs/msg/TFMessage"}


class Ros1Reading(Reading):
    """A bag of ROS 1. Raises CameraError, MissingExtraError."""

    def __init__(self, path: Path) -> None:
        need("ros1", "a bag of ROS 1")
        from rosbags.rosbag1 import Reader, ReaderError
        from rosbags.typesys import Stores, get_types_from_msg, get_typestore

        super().__init__(path)
        self._types = get_typestore(Stores.ROS1_NOETIC)
        try:
            self._bag = Reader(path)
            self._bag.open()
        except (ReaderError, OSError, ValueError, LookupError) as error:
            raise CameraError(f"{path}: no bag of ROS 1 ({one_line(error)})") from None
        for connection in self._bag.connections:
            name = connection.msgtype
            kind = short(RENAMED.get(name, name))
            if kind in FIELDS and name not in self._types.types:
                self._types.register(get_types_from_msg(FIELDS[kind], name))  # ROS 2's, never the file's
            self.topics.setdefault(connection.topic, Topic(one_line(kind))).count += connection.msgcount

    def messages(self, topic: str) -> Iterator[tuple[int, Any]]:
        """Those of a topic by their log times."""
        if self.topics[topic].kind not in FIELDS:
            raise CameraError(f"{self.path}: {topic} is {self.topics[topic].kind}, a kind that edgemap does not read")
        chosen = [connection for connection in self._bag.connections if connection.topic == topic]
        try:
            for connection, log_ns, data in self._bag.messages(connections=chosen):
                message: Any = self._types.deserialize_ros1(data, connection.msgtype)
                pairs = ((field.name.lower(), getattr(message, field.name)) for field in fields(message))  # K, D
                yield log_ns, SimpleNamespace(**dict(pairs))
        except Exception as error:  # what rosbags and its decompressors raise at damaged bytes
            raise CameraError(f"{self.path}: damaged recording ({one_line(error)})") from None

    def close(self) -> None:
        """Closes the file."""
        self._bag.close()
