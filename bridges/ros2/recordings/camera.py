"""An MCAP recording as a camera: every picture of one topic, in order, with the calibration in the file."""

import math
from collections.abc import Iterator
from dataclasses import replace
from itertools import islice
from typing import Any

from edgemap.bridges.ros2.messages.definitions import ns_of, to_s
from edgemap.bridges.ros2.messages.topics import DEPTH, EDITS, SEARCHED, STAMPS
from edgemap.bridges.ros2.recordings.facts import RECORD, TRUTH_FILE, WHEEL_FILE, read_facts, read_trajectory_file
from edgemap.bridges.ros2.recordings.foreign import (
    imu_of,
    info_topics,
    lens_of,
    mount_of,
    read_wheel,
    recorded_imu,
    tf_of,
)
from edgemap.bridges.ros2.recordings.pictures import ALIGNED, compressed_picture, depth_of, own_depth_of, raw_picture
from edgemap.bridges.ros2.recordings.reader import McapReading
from edgemap.geometry.camera.intrinsics import Intrinsics
from edgemap.geometry.camera.mount import Mount
from edgemap.geometry.errors import EdgemapError
from edgemap.runtime.frames.camera import Camera, CameraInfo, SensorTopics
from edgemap.runtime.frames.errors import CameraError, CameraFault
from edgemap.runtime.frames.faults import FaultKind
from edgemap.runtime.frames.frame import Frame
from edgemap.runtime.frames.reading import user_path
from edgemap.runtime.frames.trajectory import TrackFile

PICTURE_KINDS = {"sensor_msgs/Image": raw_picture, "sensor_msgs/CompressedImage": compressed_picture}
INFO_KIND = "sensor_msgs/CameraInfo"
STAMP_TOLERANCE_S = 1e-6  # between a stamp and its whole nanoseconds


class RecordingCamera(Camera):
    """`FILE.mcap` or `FILE.mcap#/topic`: ours, or a ROS 2 bag; without a topic its first one with pictures.

    topics: of the file, for wheel odometry, inertial samples and depth, in place of those that it would take. depth:
    whether frames bring the depth that edgemap recorded, or that a bag has aligned to the colour picture.
    Stamps are the pictures' headers', or the time of recording where those are zero. A file that was cut off gives
    every complete picture and then a CameraError that says so. Raises CameraError.
    """

    def __init__(
        self,
        spec: str,
        intrinsics: Intrinsics | None = None,
        mount: Mount | None = None,
        topics: SensorTopics | None = None,
        depth: bool = True,
    ) -> None:
        super().__init__(CameraInfo(spec, intrinsics=intrinsics, mount=mount))
        file, _, topic = spec.partition("#")
        path = user_path(file)
        if not path.is_file():
            raise CameraError(f"{path}: no such file")
        self._path, self._open = path, True
        self._recording = recording = McapReading(path)
        self._last_ns: float = -math.inf
        self._exact, self._unsearched = dict[int, float](), frozenset[int]()
        try:
            wanted = topics.depth if topics else None
            self.topic = self._choose(topic, wanted)
            self._picture = PICTURE_KINDS[recording.topics[self.topic].kind]
            own = wanted is None and DEPTH in recording.topics and RECORD in recording.metadata
            self._depth = (own_depth_of(recording) if own else depth_of(recording, wanted)) if depth else None
            if RECORD in recording.metadata:
                self._exact, self._unsearched = _exact_stamps(recording), _unsearched(recording)
            self._messages = recording.messages(self.topic)
            self._ahead = self._first_complete()
            _, image, frame_id = self._ahead
            size, count = (image.shape[1], image.shape[0]), recording.topics[self.topic].count
            self.update_info(size=size, frame_count=count)
            self._describe(intrinsics, mount, frame_id, topics or SensorTopics())
        except EdgemapError:
            self.close()
            raise
        # Lens and mount were looked up in the same file: begin the pictures again behind the first complete one.
        self._messages = islice(recording.messages(self.topic), len(self._damaged) + 1, None)

    def read(self) -> Frame | None:
        """The next picture; None at the end. Raises CameraError for damage, and at the end of a file cut off."""
        if not self._open:
            return None
        if self._damaged:
            raise self._damaged.pop(0)
        decoded, self._ahead = self._ahead or self._decode(), None
        if decoded is None:
            if not self._recording.complete:
                raise CameraError(f"{self._path}: cut off, the {self._delivered} complete pictures before it were read")
            return None
        stamp_ns, image, _ = decoded
        name = f"{self.info.name}#{self._delivered}"
        stamp_s = self._exact.get(stamp_ns, to_s(stamp_ns))
        if stamp_ns <= self._last_ns or stamp_s < self._last_s:  # a float may be the same for two nanoseconds
            raise CameraFault(FaultKind.CLOCK, f"{name}: at {stamp_s:.6f} s, not after {self._last_s:.6f} s, skipped")
        self._last_ns = stamp_ns
        depth = None if self._depth is None else self._depth.at(stamp_ns)
        return replace(self.frame(image, stamp_s, name, depth), search=stamp_ns not in self._unsearched)

    def close(self) -> None:
        """Close the file."""
        self._open = False
        self._recording.close()

    def _choose(self, topic: str, depth: str | None) -> str:
        topics, beside = self._recording.topics, (DEPTH, depth)
        pictures = [
            name for name in self._recording.topics_of(*PICTURE_KINDS) if name not in beside and ALIGNED not in name
        ]
        if topic in pictures:
            return topic
        has = ", ".join(pictures) or "none"
        if topic in topics:
            kind = topics[topic].kind or "untyped"
            raise CameraError(f"{self._path}: {topic} is {kind}, not pictures (topics with pictures: {has})")
        if topic:
            raise CameraError(f"{self._path}: no topic {topic} (topics with pictures: {has})")
        if not pictures:
            there = ", ".join(f"{name} ({found.kind})" for name, found in topics.items()) or "no messages at all"
            raise CameraError(f"{self._path}: no topic with sensor_msgs Image or CompressedImage; has {there}")
        return pictures[0]

    def _first_complete(self) -> tuple[int, Any, str]:
        """The first picture that can be decoded; those before it are reported when the frames are read."""
        self._damaged: list[CameraFault] = []
        while True:
            try:
                found = self._decode()
            except CameraFault as fault:
                self._damaged.append(fault)
                continue
            if found is None:
                break
            return found
        why = f", {len(self._damaged):,} damaged: {self._damaged[0]}" if self._damaged else ""
        raise CameraError(f"{self._path}: {self.topic} has no complete picture{why}")

    def _decode(self) -> tuple[int, Any, str] | None:
        """Stamp in ns, picture, frame id of the next message."""
        found = next(self._messages, None)
        if found is None:
            return None
        log_ns, decode = found
        message = decode()
        try:
            image = self._picture(message, f"{self.info.name} picture {self._delivered}")
        except CameraError as error:
            raise CameraFault(FaultKind.DAMAGED, f"{error}, skipped") from None
        return ns_of(message.header.stamp) or log_ns, image, message.header.frame_id

    def _describe(
        self, intrinsics: Intrinsics | None, mount: Mount | None, frame_id: str, topics: SensorTopics
    ) -> None:
        """Lens, mount, rate, truth, wheels and IMU: as edgemap wrote them, else from CameraInfo and tf."""
        recording = self._recording
        if topics.wheels:
            self.update_info(wheel=TrackFile(f"{self._path}#{topics.wheels}", read_wheel))
        if RECORD in recording.metadata:
            facts = read_facts(recording.metadata[RECORD], f"{self._path}")
            own = topics.imu is None
            self.update_info(
                intrinsics=intrinsics or facts.intrinsics,
                mount=mount or facts.mount,
                rate_hz=facts.rate_hz,
                inference=facts.inference,
                calibration=facts.calibration or {},
                imu=recorded_imu(recording) if own else imu_of(recording, tf_of(recording), frame_id, topics.imu),
                edits=tuple(str(line) for _, line in _values(recording, EDITS)),
            )
            if topics.wheels is None and WHEEL_FILE in recording.attachments:
                self.update_info(wheel=TrackFile(str(self._path), read_wheel))
            if TRUTH_FILE in recording.attachments:
                where = f"{self._path}: {TRUTH_FILE}"
                self.update_info(truth=read_trajectory_file(recording.attachments[TRUTH_FILE], where))
            return
        if intrinsics is None and (message := self._lens_message()) is not None:
            intrinsics = lens_of(message, "rect" in self.topic, f"{self._path}")
        tree = tf_of(recording)
        self.update_info(
            intrinsics=intrinsics,
            mount=mount_of(tree, frame_id) if mount is None else mount,
            imu=imu_of(recording, tree, frame_id, topics.imu),
            rate_hz=self._rate_hz(),
        )

    def _lens_message(self) -> Any:
        """The CameraInfo beside the pictures (image_transport's custom), or the only one in the file; else None."""
        infos = self._recording.topics_of(INFO_KIND)
        beside = [name for name in info_topics(self.topic) if name in infos]
        chosen = beside or (infos if len(infos) == 1 else [])
        found = next(self._recording.messages(chosen[0]), None) if chosen else None
        return found[1]() if found else None

    def _rate_hz(self) -> float | None:
        """From the first pictures' times of recording."""
        messages = self._recording.messages(self.topic)
        times = [log_ns for (log_ns, _), _ in zip(messages, range(30), strict=False)]
        span_s = to_s(times[-1] - times[0])
        return (len(times) - 1) / span_s if len(times) > 1 and math.isfinite(span_s) and span_s > 0 else None


def _values(recording: McapReading, topic: str) -> Iterator[tuple[int, Any]]:
    """Log time in ns and value of each std_msgs message of a topic; none where there is no such topic."""
    messages = recording.messages(topic) if topic in recording.topics else ()
    return ((log_ns, decode().data) for log_ns, decode in messages)


def _unsearched(recording: McapReading) -> frozenset[int]:
    """Stamps of the pictures that a budget did not have searched, ns."""
    return frozenset(log_ns for log_ns, searched in _values(recording, SEARCHED) if float(searched) == 0.0)


def _exact_stamps(recording: McapReading) -> dict[int, float]:
    """Stamps that are finer than a nanosecond, by their nearest one."""
    stamps = {log_ns: float(stamp_s) for log_ns, stamp_s in _values(recording, STAMPS)}
    if wrong := [ns for ns, stamp_s in stamps.items() if not abs(stamp_s - to_s(ns)) < STAMP_TOLERANCE_S]:
        raise CameraError(f"{recording.path}: {STAMPS} says {stamps[wrong[0]]} s at {to_s(wrong[0]):.9f} s")
    return stamps
