"""`--camera ros2:/topic`: pictures of a ROS 2 camera, with calibration and mount from CameraInfo and tf."""

import time
from collections.abc import Callable
from typing import Any

from edgemap.geometry.camera.intrinsics import Intrinsics
from edgemap.geometry.camera.mount import Mount
from edgemap.runtime.frames.errors import CameraError
from edgemap.runtime.frames.messages.stamps import ns_of, to_s
from edgemap.runtime.frames.messages.topics import INFO, KINDS
from edgemap.runtime.inputs.cameras.live import LiveCamera
from edgemap.runtime.inputs.cameras.protocol import Picture
from edgemap.runtime.inputs.cameras.recovery import RecoveryRule
from edgemap.runtime.inputs.recordings.foreign import info_topics, lens_of, mount_of
from edgemap.runtime.inputs.recordings.pictures import compressed_picture, raw_picture
from edgemap.runtime.inputs.ros2.depth import DepthTopic
from edgemap.runtime.inputs.ros2.node import Node, Subscription
from edgemap.runtime.inputs.ros2.tf import TfListener

PICTURES: dict[str, Callable[[Any, str], Any]] = {
    "sensor_msgs/msg/Image": raw_picture,
    "sensor_msgs/msg/CompressedImage": compressed_picture,
}
PUBLISHER_S, PICTURE_S, BESIDE_S, GRAB_S = 5.0, 5.0, 1.0, 0.5  # waits: for each of them


class Ros2Device:
    """A subscription to a topic with pictures, open since its first picture, and to depth. Stamps are the messages'.

    Raises CameraError where no such topic is published, or no picture arrives.
    """

    def __init__(self, node: Node, topic: str, name: str, depth: DepthTopic | None = None) -> None:
        self.rate_hz: float | None = None
        self._name, self._depth = name, depth
        kind = node.kind_of(topic, PUBLISHER_S)
        if kind not in PICTURES:
            others = ", ".join(name for name, known in sorted(node.published().items()) if known in PICTURES) or "none"
            what = f"{topic} is {kind}, not pictures" if kind else f"nobody publishes {topic}"
            raise CameraError(f"camera {name}: {what} within {PUBLISHER_S:.0f} s (topics with pictures: {others})")
        self._decode = PICTURES[kind]
        # Asked for before the first picture, so that they come beside it.
        infos = [node.subscription(info, KINDS[INFO]) for info in info_topics(topic)]
        self._pictures = node.subscription(topic, kind, depth=2)
        self._first = self._next(PICTURE_S)
        if self._first is None:
            raise CameraError(f"camera {name}: no picture on {topic} within {PICTURE_S:.0f} s")
        _, image, self.frame_id = self._first
        self.size = (image.shape[1], image.shape[0])
        info = _first_of(infos, BESIDE_S)
        self.intrinsics: Intrinsics | None = lens_of(info, "rect" in topic, name) if info else None

    def grab(self) -> Picture | None:
        """The newest picture; None where none came. Raises CameraError or Ros2Error for one that is damaged."""
        found, self._first = self._first or self._next(GRAB_S), None
        if found is None:
            return None
        stamp_s, image, _ = found
        return Picture(stamp_s, image, None if self._depth is None else self._depth.at(stamp_s, self.intrinsics))

    def close(self) -> None:
        """Unsubscribe."""
        self._pictures.close()
        if self._depth is not None:
            self._depth.close()

    def _next(self, timeout_s: float) -> tuple[float, Any, str] | None:
        message = self._pictures.newest() if self._pictures.wait(timeout_s) else None
        if message is None:
            return None
        stamp_s = to_s(ns_of(message.header.stamp)) or time.time()
        return stamp_s, self._decode(message, self._name), message.header.frame_id


class Ros2Driver:
    """Opens the topic of a SPEC `ros2:/topic`."""

    def __init__(self, node: Node, topic: str, depth: DepthTopic | None = None) -> None:
        self.name = f"ros2:{topic}"
        self.frame_id = ""
        self._node, self._topic, self._depth = node, topic, depth
        self._tf = TfListener(node, self.name)

    def open(self) -> Ros2Device:
        """Subscribe. Raises CameraError as `Ros2Device` does."""
        device = Ros2Device(self._node, self._topic, self.name, self._depth)
        self.frame_id = device.frame_id
        return device

    def reset(self) -> bool:
        """There is no hardware here."""
        return False

    def watch(self, changed: Callable[[bool], None]) -> None:
        """Nothing to watch: DDS does not report that a publisher has gone."""

    def mount(self) -> Mount | None:
        """Mount of the pictures' frame; None where tf does not connect it to base_footprint. Raises CameraError."""
        return self._tf.ask(lambda tree: mount_of(tree, self.frame_id))


class Ros2Camera(LiveCamera):
    """A topic with pictures as a live camera. optical: the frame that its messages name."""

    def __init__(
        self,
        node: Node,
        topic: str,
        intrinsics: Intrinsics | None = None,
        mount: Mount | None = None,
        rule: RecoveryRule | None = None,
        depth: DepthTopic | None = None,
    ) -> None:
        driver = Ros2Driver(node, topic, depth)
        super().__init__(driver, intrinsics, mount, rule)
        self.optical = driver.frame_id
        self.mount = mount or driver.mount()


def _first_of(readers: list[Subscription], timeout_s: float) -> Any | None:
    """The first message on any of them."""
    until_s = time.monotonic() + timeout_s
    while time.monotonic() < until_s:
        for reader in readers:
            if reader.wait(0.01) and (message := reader.newest()) is not None:
                return message
    return None
