"""Depth pictures on a ROS 2 topic, beside the colour pictures of another."""

import time
from collections import deque
from contextlib import suppress
from typing import Any

from edgemap.bridges.ros2.dds.node import Node, Subscription
from edgemap.bridges.ros2.dds.sources import LATE_S
from edgemap.bridges.ros2.messages.definitions import ns_of, to_s
from edgemap.bridges.ros2.messages.topics import INFO
from edgemap.bridges.ros2.recordings.foreign import info_topics, lens_of
from edgemap.bridges.ros2.recordings.pictures import READERS, aligned
from edgemap.bridges.ros2.recordings.reading import short
from edgemap.geometry.camera.intrinsics import Intrinsics
from edgemap.runtime.frames.camera import NO_DEPTH
from edgemap.runtime.frames.errors import CameraError
from edgemap.runtime.frames.limits import EVERY_S
from edgemap.runtime.frames.timing import StreamTimer
from edgemap.runtime.inputs.drives.pictures import APART_S, Depth

KEPT = 6  # depth pictures that may belong to a picture yet to come
SAME_SHARE = 0.01  # of the picture's width: focal lengths and centres that differ by less are one lens


class DepthTopic:
    """Depth registered to the colour pictures, looked up by increasing stamps; a text says why there is none, since
    depth is optional. topic: None for the aligned topic of Intel's driver, once it is published. Late or damaged
    pictures, and those with other intrinsics in their CameraInfo, are dropped.
    """

    def __init__(self, node: Node, topic: str | None = None) -> None:
        self._node, self._topic = node, topic
        self._messages: Subscription | None = None
        self._infos: list[Subscription] = []
        self._waiting: deque[tuple[float, Any]] = deque(maxlen=KEPT)
        self._lens: Intrinsics | None = None
        self._came, self._kind = False, ""  # with the last picture; of the topic's messages
        self._look_timer = StreamTimer(EVERY_S)

    def at(self, stamp_s: float, lens: Intrinsics | None) -> Depth | str | None:
        """The depth picture of a colour picture and its lens, or why there is none; None where no topic has any."""
        messages = self._messages or self._open()
        if messages is None:
            return f"{self._topic} is {self._kind or 'not published'}, no depth" if self._topic else None
        for message in messages.take_while(lambda: not self._reaches(stamp_s), LATE_S if self._came else 0.0):
            self._waiting.append((to_s(ns_of(message.header.stamp)), message))
        while self._waiting and self._waiting[0][0] < stamp_s - APART_S:
            self._waiting.popleft()
        self._came = bool(self._waiting) and self._waiting[0][0] <= stamp_s + APART_S
        if not self._came:
            return NO_DEPTH
        if not self._of(lens):
            return f"{messages.topic} is of another lens than the pictures, by its CameraInfo"
        try:
            return READERS[self._kind](self._waiting.popleft()[1], messages.topic)
        except CameraError as error:
            return str(error)

    def close(self) -> None:
        """Unsubscribe."""
        for subscription in (*self._infos, self._messages):
            if subscription is not None:
                subscription.close()
        self._messages, self._infos = None, []
        self._waiting.clear()

    def _open(self) -> Subscription | None:
        """Subscribe once the topic is published."""
        if not self._look_timer.due(time.monotonic()):
            return None
        kinds = {name: short(kind) for name, kind in self._node.published().items()}
        topic = self._topic or aligned(kinds)
        self._kind = kinds.get(topic or "", "")
        if topic is None or self._kind not in READERS:
            return None
        self._infos = [Subscription(self._node, info, INFO.kind, depth=1) for info in info_topics(topic)]
        self._messages = Subscription(self._node, topic, self._kind.replace("/", "/msg/"), depth=KEPT)
        return self._messages

    def _reaches(self, stamp_s: float) -> bool:
        """Whether a depth picture of a colour picture's stamp, or a later one, has come."""
        return bool(self._waiting) and self._waiting[-1][0] >= stamp_s - APART_S

    def _of(self, lens: Intrinsics | None) -> bool:
        """Whether depth is of this lens, as far as its CameraInfo says."""
        for info in self._infos:
            if self._lens is None and (message := info.newest()) is not None:
                with suppress(CameraError):
                    self._lens = lens_of(message, "image_rect", info.topic)
        if self._lens is None or lens is None:
            return True
        pairs = ((getattr(one, name) for one in (self._lens, lens)) for name in ("fx", "fy", "cx", "cy"))
        return all(abs(own - other) < SAME_SHARE * lens.width for own, other in pairs)
