"""An MCAP recording as a camera: every picture of one topic, in order, with the calibration in the file."""

import math
from collections.abc import Iterator
from contextlib import closing
from dataclasses import replace
from typing import Any

from edgemap.bridges.ros2.messages.definitions import to_s
from edgemap.bridges.ros2.messages.tf_chain import PATH
from edgemap.bridges.ros2.messages.topics import DEPTH, EDITS, SEARCHED, STAMPS, TF
from edgemap.bridges.ros2.recordings.facts import RECORD, TRUTH_FILE, WHEEL_FILE, read_facts, read_trajectory_file
from edgemap.bridges.ros2.recordings.foreign import (
    IMU_KIND,
    WHEEL_KIND,
    imu_of,
    info_topics,
    lens_of,
    mount_of,
    read_wheel,
    recorded_imu,
    tf_of,
)
from edgemap.bridges.ros2.recordings.pictures import (
    PICTURE_KINDS,
    depth_of,
    depth_topic,
    kind_of_pictures,
    own_depth_of,
)
from edgemap.bridges.ros2.recordings.reader import open_reading
from edgemap.bridges.ros2.recordings.reading import Reading
from edgemap.bridges.ros2.recordings.tf_poses import tf_poses
from edgemap.geometry.camera.intrinsics import Intrinsics
from edgemap.geometry.camera.mount import Mount
from edgemap.geometry.errors import EdgemapError
from edgemap.runtime.frames.camera import Camera, CameraInfo, SensorTopics
from edgemap.runtime.frames.errors import CameraError, CameraFault
from edgemap.runtime.frames.faults import FaultKind
from edgemap.runtime.frames.frame import Frame
from edgemap.runtime.frames.reading import user_path
from edgemap.runtime.inputs.drives.pictures import Levels
from edgemap.runtime.motion.given_poses import GivenPoses
from edgemap.runtime.step.pose_journal import SAME_S

INFO_KIND, TF_KIND = "sensor_msgs/CameraInfo", "tf2_msgs/TFMessage"
USABLE = "colour", "infrared"  # kinds of pictures, the first that there is
_Picture = tuple[int, int, Any, str]  # stamp in ns, its header's, picture, frame id


class RecordingCamera(Camera):
    """`FILE.mcap` or `FILE.mcap#/topic`: ours, or a bag of ROS, a file or its folder; without a topic its first one
    with colour pictures, else with infrared ones.

    topics: of the file, for wheel odometry, inertial samples and depth, in place of those that it would take. depth:
    whether frames bring the depth that edgemap recorded, or that a bag has aligned to the colour picture. rotate: as of
    `mount_of`.
    Stamps are the pictures' headers', or the time of recording where all of those are zero. A file that was cut off
    gives every complete picture and then a CameraError that says so. Raises CameraError.
    """

    def __init__(
        self,
        spec: str,
        intrinsics: Intrinsics | None = None,
        mount: Mount | None = None,
        topics: SensorTopics | None = None,
        depth: bool = True,
        rotate: int = 0,
    ) -> None:
        super().__init__(CameraInfo(spec, intrinsics=intrinsics, mount=mount))
        file, _, topic = spec.partition("#")
        path = user_path(file)
        if not path.exists():
            raise CameraError(f"{path}: no such file")
        self._path, self._open, self._rotate = path, True, rotate
        self._recording = recording = open_reading(path)
        self._levels = Levels()
        self._notes: list[str] = []
        self._info_topic = self._imu_topic = ""
        self._exact, self._unsearched = dict[int, float](), frozenset[int]()
        try:
            wanted = topics.depth if topics else None
            self.topic = self._choose(topic, wanted)
            self._picture = PICTURE_KINDS[recording.topics[self.topic].kind]
            own = wanted is None and DEPTH in recording.topics and RECORD in recording.metadata
            beside = DEPTH if own else depth_topic(recording, wanted) if depth else None
            self._depth = (
                (own_depth_of(recording) if own else depth_of(recording, beside)) if depth and beside else None
            )
            if RECORD in recording.metadata:
                self._exact, self._unsearched = _exact_stamps(recording), _unsearched(recording)
            self._pictures, self._ahead = self._decoded(), list[_Picture | CameraFault]()
            self._first_ns, _, image, frame_id = self._first_complete()
            if TF in recording.topics:
                self.update_info(tf=self._tf)
            size, count = (image.shape[1], image.shape[0]), recording.topics[self.topic].count
            self.update_info(size=size, frame_count=count)
            self._describe(intrinsics, mount, frame_id, topics or SensorTopics())
            if RECORD not in recording.metadata:
                self.update_info(notes=self._taken(beside, (topics or SensorTopics()).wheels))
        except EdgemapError:
            self.close()
            raise

    def read(self) -> Frame | None:
        """The next picture; None at the end. Raises CameraError for damage, and at the end of a file cut off."""
        if not self._open:
            return None
        decoded = self._ahead.pop(0) if self._ahead else next(self._pictures, None)
        if isinstance(decoded, CameraFault):
            raise decoded
        if decoded is None:
            if not self._recording.complete:
                raise CameraError(f"{self._path}: cut off, the {self._delivered} complete pictures before it were read")
            return None
        stamp_ns, own_ns, image, _ = decoded
        name = f"{self.info.name}#{self._delivered}"
        stamp_s = self._exact.get(own_ns, to_s(stamp_ns)) if stamp_ns == own_ns else to_s(stamp_ns)
        if stamp_s < self._last_s:  # a float may be the same for two nanoseconds
            raise CameraFault(FaultKind.CLOCK, f"{name}: at {stamp_s:.6f} s, not after {self._last_s:.6f} s, skipped")
        height, width = image.shape[:2]
        if self._delivered and self.info.size != (width, height):
            raise CameraFault(FaultKind.SIZE, f"{name}: picture is {width}x{height}, not as those before, skipped")
        depth = None if self._depth is None else self._depth.at(stamp_ns)
        return replace(self.frame(image, stamp_s, name, depth), search=own_ns not in self._unsearched)

    def close(self) -> None:
        """Close the file."""
        self._open = False
        self._recording.close()

    def _choose(self, topic: str, depth: str | None) -> str:
        recording = self._recording
        topics, own = recording.topics, RECORD in recording.metadata
        pictures = [name for name in recording.topics_of(*PICTURE_KINDS) if name not in (DEPTH if own else "", depth)]
        self._kinds: dict[str, str] = {}
        if topic not in pictures and len(pictures) > 1:
            self._kinds = {name: self._kind(name) for name in pictures}
        has = ", ".join(name for name in pictures if self._kinds.get(name, USABLE[0]) in USABLE) or "none"
        if topic in pictures:
            return topic
        if topic in topics:
            kind = topics[topic].kind or "untyped"
            raise CameraError(f"{self._path}: {topic} is {kind}, not pictures (topics with pictures: {has})")
        if topic:
            raise CameraError(f"{self._path}: no topic {topic} (topics with pictures: {has})")
        usable = sorted((name for name in pictures if self._kinds.get(name, USABLE[0]) in USABLE), key=self._rank)
        if not usable:
            kinds = {name: self._kinds.get(name, found.kind) for name, found in topics.items()}
            there = ", ".join(f"{name} ({kind})" for name, kind in kinds.items()) or "no messages at all"
            raise CameraError(
                f"{self._path}: no topic with sensor_msgs Image or CompressedImage of colour or grey; has {there}"
            )
        return usable[0]

    def _kind(self, topic: str) -> str:
        try:
            return kind_of_pictures(topic, next(self._recording.stamped(topic))[1])
        except CameraError:
            return "damaged"

    def _rank(self, topic: str) -> int:
        return USABLE.index(self._kinds.get(topic, USABLE[0]))

    def _taken(self, depth: str | None, wheels: str | None) -> tuple[str, ...]:
        """What was taken of a foreign recording and what was not, as lines."""
        info, taken, left = self.info, dict[str, str](), dict[str, str]()
        for name, topic in self._recording.topics.items():
            if name == self.topic:
                taken[name] = f"{topic.count} pictures" + (", infrared" if self._kinds.get(name) == "infrared" else "")
            elif name == depth:
                taken[name] = "depth"
            elif name == self._info_topic and info.intrinsics is not None:
                taken[name] = "lens"
            elif topic.kind in (TF_KIND, PATH):
                taken[name] = "tf" if topic.kind == TF_KIND else "path, for --odometry tf"
            elif not topic.count:
                left[name] = "no messages"
            elif topic.kind in PICTURE_KINDS:
                kind = self._kinds.get(name, "pictures")
                left[name] = f"depth; --topics depth={name}" if kind == "depth" else f"{kind}; #{name}"
            elif topic.kind == WHEEL_KIND:
                (taken if name == wheels else left)[name] = "wheels" if name == wheels else f"--topics wheels={name}"
            elif topic.kind == IMU_KIND:
                used = name == self._imu_topic
                (taken if used else left)[name] = (
                    "IMU" if used else "tf does not join it to the pictures, or another is used"
                )
            else:
                left[name] = topic.kind
        lines = [f"{title}: " + ", ".join(f"{name} ({what})" for name, what in some.items())
                 for title, some in (("taken", taken), ("not taken", left)) if some]  # fmt: skip
        return (*lines, *self._notes)

    def _first_complete(self) -> _Picture:
        """The first picture that can be decoded; what is wrong before it is raised when the frames are read."""
        for found in self._pictures:
            self._ahead.append(found)
            if not isinstance(found, CameraFault):
                return found
        why = f", {len(self._ahead):,} damaged: {self._ahead[0]}" if self._ahead else ""
        raise CameraError(f"{self._path}: {self.topic} has no complete picture{why}")

    def _decoded(self) -> Iterator[_Picture | CameraFault]:
        """All pictures in order; and faults, of those that are dropped, and before one where the clock was set."""
        for stamp_ns, own_ns, message, fault in self._recording.samples(self.topic):
            if fault:
                yield CameraFault(FaultKind.CLOCK, f"{self.info.name}#{self._delivered}: {fault}")
            if stamp_ns is None:
                continue
            try:
                image = self._picture(message, f"{self.info.name} picture {self._delivered}", self._levels)
            except CameraError as error:
                yield CameraFault(FaultKind.DAMAGED, f"{error}, skipped")
                continue
            yield stamp_ns, own_ns, image, message.header.frame_id

    def _tf(self, frames: str, mount: Mount) -> GivenPoses:
        """The base's poses by the tf of the whole file, from its first picture on."""
        with closing(open_reading(self._path)) as recording:
            return tf_poses(recording, frames, mount, to_s(self._first_ns))

    def _describe(
        self, intrinsics: Intrinsics | None, mount: Mount | None, frame_id: str, topics: SensorTopics
    ) -> None:
        """Lens, mount, rate, truth, wheels and IMU: as edgemap wrote them, else from CameraInfo and tf."""
        recording = self._recording
        if topics.wheels:
            self.update_info(wheel=read_wheel(f"{self._path}#{topics.wheels}"))
        if RECORD in recording.metadata:
            facts = read_facts(recording.metadata[RECORD], f"{self._path}")
            own = topics.imu is None
            self.update_info(
                intrinsics=intrinsics or facts.intrinsics,
                mount=mount or facts.mount,
                rate_hz=facts.rate_hz,
                inference=facts.inference,
                calibration=facts.calibration or {},
                imu=recorded_imu(recording) if own else imu_of(recording, tf_of(recording), frame_id, topics.imu)[1],
                edits=tuple(str(line) for _, line in _values(recording, EDITS)),
            )
            if topics.wheels is None and WHEEL_FILE in recording.attachments:
                self.update_info(wheel=read_wheel(str(self._path)))
            if TRUTH_FILE in recording.attachments:
                where = f"{self._path}: {TRUTH_FILE}"
                self.update_info(truth=read_trajectory_file(recording.attachments[TRUTH_FILE], where))
            return
        if intrinsics is None and (message := self._lens_message()) is not None:
            intrinsics = lens_of(message, self.topic, f"{self._path}", self.info.size)
        tree = tf_of(recording)
        if mount is None:
            mount, text = mount_of(tree, frame_id, self._rotate)
            self._notes += [text] if text else []
        self._imu_topic, imu = imu_of(recording, tree, frame_id, topics.imu)
        self._notes += self._levels.notes
        self.update_info(intrinsics=intrinsics, mount=mount, imu=imu, rate_hz=self._rate_hz())

    def _lens_message(self) -> Any:
        """The CameraInfo beside the pictures (image_transport's custom), or the only one in the file; else None."""
        infos = self._recording.topics_of(INFO_KIND)
        beside = [name for name in info_topics(self.topic) if name in infos]
        chosen = beside or (infos if len(infos) == 1 else [])
        if not chosen:
            return None
        self._info_topic = chosen[0]
        return next(message for _, message in self._recording.stamped(chosen[0]))

    def _rate_hz(self) -> float | None:
        """From the first pictures' times of recording."""
        messages = self._recording.messages(self.topic)
        times = [log_ns for (log_ns, _), _ in zip(messages, range(30), strict=False)]
        span_s = to_s(times[-1] - times[0])
        return (len(times) - 1) / span_s if len(times) > 1 and math.isfinite(span_s) and span_s > 0 else None


def _values(recording: Reading, topic: str) -> Iterator[tuple[int, Any]]:
    """Log time in ns and value of each std_msgs message of a topic; none where there is no such topic."""
    messages = recording.messages(topic) if topic in recording.topics else ()
    return ((log_ns, decode().data) for log_ns, decode in messages)


def _unsearched(recording: Reading) -> frozenset[int]:
    """Stamps of the pictures that a budget did not have searched, ns."""
    return frozenset(log_ns for log_ns, searched in _values(recording, SEARCHED) if float(searched) == 0.0)


def _exact_stamps(recording: Reading) -> dict[int, float]:
    """Stamps that are finer than a nanosecond, by their nearest one."""
    stamps = {log_ns: float(stamp_s) for log_ns, stamp_s in _values(recording, STAMPS)}
    if wrong := [ns for ns, stamp_s in stamps.items() if not abs(stamp_s - to_s(ns)) < SAME_S]:
        raise CameraError(f"{recording.path}: {STAMPS} says {stamps[wrong[0]]} s at {to_s(wrong[0]):.9f} s")
    return stamps
