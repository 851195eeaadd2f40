"""What is recorded: pictures with lens, mount, wheel odometry and truth, and what a run made of them."""

from __future__ import annotations

from pathlib import Path

import cv2

from edgemap.geometry.objects.map_object import MapObject
from edgemap.runtime.errors import RecordingError
from edgemap.runtime.frame import Frame
from edgemap.runtime.recordings import messages
from edgemap.runtime.recordings.facts import (
    RECORD,
    TRUTH_FILE,
    WHEEL_FILE,
    Facts,
    facts_record,
    trajectory_file,
)
from edgemap.runtime.recordings.map_messages import detections_3d, markers
from edgemap.runtime.recordings.stamps import to_ns, to_s
from edgemap.runtime.recordings.topics import (
    BOXES,
    INFO,
    MARKERS,
    OBJECTS,
    ODOMETRY,
    PICTURES,
    STAMPS,
    TF,
    TRUTH,
    WHEEL,
)
from edgemap.runtime.recordings.writer import McapFile
from edgemap.runtime.slam import StepResult
from edgemap.runtime.trajectory import Trajectory

JPEG_QUALITY = 90
MAP_EVERY = 10  # frames between two maps
ODOMETRY_KIND = "nav_msgs/msg/Odometry"


class Recorder:
    """Frames, and perhaps a run's results, into an MCAP file. lossless: PNG instead of JPEG.

    wheel: the wheels' own integrated poses; truth: the drive's own poses from its start. Raises RecordingError.
    """

    def __init__(
        self,
        path: Path,
        facts: Facts,
        *,
        lossless: bool = False,
        wheel: Trajectory | None = None,
        truth: Trajectory | None = None,
    ) -> None:
        self.path, self.frames = path, 0
        self._facts, self._lossless = facts, lossless
        self._tracks = [
            _Track(topic, name, track)
            for topic, name, track in ((WHEEL, WHEEL_FILE, wheel), (TRUTH, TRUTH_FILE, truth))
            if track is not None
        ]
        self._file = McapFile(path)
        self._file.metadata(RECORD, facts_record(facts))
        for track in self._tracks:
            self._file.attach(track.file, "application/json", trajectory_file(track.way))
        self._last: tuple[int, list[MapObject]] | None = None
        self._last_stamp_s: float | None = None

    def picture(self, frame: Frame) -> int:
        """Record a frame with the lens, the mount and what the wheels did until then; its stamp in nanoseconds."""
        stamp_ns = to_ns(frame.stamp_s)
        for track in self._tracks:
            track.write_until(self._file, stamp_ns)
        if to_s(stamp_ns) != frame.stamp_s:  # finer than a nanosecond: the replay shall have it all the same
            self._file.write(STAMPS, "std_msgs/msg/Float64", stamp_ns, {"data": frame.stamp_s})
        if self._facts.intrinsics is not None:
            info = messages.camera_info(stamp_ns, self._facts.intrinsics)
            self._file.write(INFO, "sensor_msgs/msg/CameraInfo", stamp_ns, info)
        if self._facts.mount is not None:
            # Again and again on /tf, and not once on /tf_static: players of a part of the file have it too.
            seat = messages.tf(messages.mount_transform(stamp_ns, self._facts.mount))
            self._file.write(TF, "tf2_msgs/msg/TFMessage", stamp_ns, seat)
        encoding = "png" if self._lossless else "jpeg"
        image = messages.compressed_image(stamp_ns, self._encode(frame), encoding)
        self._file.write(PICTURES, "sensor_msgs/msg/CompressedImage", stamp_ns, image)
        self.frames += 1
        return stamp_ns

    def results(self, stamp_ns: int, result: StepResult, objects: list[MapObject]) -> None:
        """Record what a step found: pose, boxes, and every `MAP_EVERY` frames the map."""
        pose, stamp_s = result.pose_map_base, result.frame.stamp_s
        dt_s = 0.0 if self._last_stamp_s is None else stamp_s - self._last_stamp_s
        self._last_stamp_s = stamp_s
        moved = result.motion.motion
        velocity = (moved.x_m / dt_s, moved.y_m / dt_s, moved.yaw_rad / dt_s) if dt_s > 0 else (0.0, 0.0, 0.0)
        message = messages.odometry(stamp_ns, pose, result.pose_covariance, velocity)
        self._file.write(ODOMETRY, ODOMETRY_KIND, stamp_ns, message)
        place = messages.tf(messages.pose_transform(stamp_ns, pose))
        self._file.write(TF, "tf2_msgs/msg/TFMessage", stamp_ns, place)
        boxes = messages.detections_2d(stamp_ns, result)
        self._file.write(BOXES, "vision_msgs/msg/Detection2DArray", stamp_ns, boxes)
        self._last = (stamp_ns, objects)
        if (self.frames - 1) % MAP_EVERY == 0:
            self._write_map()

    def close(self) -> None:
        """The last map, and the file's end; may be called twice."""
        try:
            self._write_map()
        finally:
            self._file.close()

    def _write_map(self) -> None:
        if self._last is not None:
            (stamp_ns, objects), self._last = self._last, None
            self._file.write(OBJECTS, "vision_msgs/msg/Detection3DArray", stamp_ns, detections_3d(stamp_ns, objects))
            self._file.write(MARKERS, "visualization_msgs/msg/MarkerArray", stamp_ns, markers(stamp_ns, objects))

    def _encode(self, frame: Frame) -> bytes:
        suffix, options = ".jpg", [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY]
        if self._lossless:
            suffix, options = ".png", [cv2.IMWRITE_PNG_COMPRESSION, 1]  # the quickest that still compresses
        good, data = cv2.imencode(suffix, frame.image, options)
        if not good:
            raise RecordingError(f"{frame.name}: OpenCV does not encode it as {suffix}")
        return data.tobytes()


class _Track:
    """A trajectory that is written as it happens, between the pictures."""

    def __init__(self, topic: str, file: str, way: Trajectory) -> None:
        self.topic, self.file, self.way = topic, file, way
        self._next = 0

    def write_until(self, file: McapFile, stamp_ns: int) -> None:
        """The poses up to this stamp that are not written yet."""
        while self._next < len(self.way.poses) and (now_ns := to_ns(float(self.way.stamps_s[self._next]))) <= stamp_ns:
            message = messages.odometry(now_ns, self.way.poses[self._next])
            file.write(self.topic, ODOMETRY_KIND, now_ns, message)
            self._next += 1
