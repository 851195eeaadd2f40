"""The messages of a run's results, from which recordings and live outputs select."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import lru_cache

from edgemap.bridges.ros2.messages import build, topics
from edgemap.bridges.ros2.messages.definitions import Message, to_ns
from edgemap.bridges.ros2.messages.map_messages import (
    detections_3d,
    grid_message,
    markers,
    scan_message,
)
from edgemap.bridges.ros2.messages.topics import FrameIds, Topic
from edgemap.geometry.camera.intrinsics import Intrinsics
from edgemap.geometry.camera.mount import Mount
from edgemap.geometry.grid.occupancy_grid import OccupancyGrid
from edgemap.geometry.map_object import MapObject
from edgemap.geometry.objects.annotations import MapIdentity
from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.frame import Frame, jpeg, png
from edgemap.runtime.outputs.map_formats.grid import live_grid
from edgemap.runtime.step.slam import StepResult

MAP_EVERY = 10  # frames between two maps


@dataclass(frozen=True, slots=True)
class Outgoing:
    """One message to send. make: builds it on demand."""

    topic: Topic
    stamp_ns: int
    make: Callable[[], Message]


@dataclass(slots=True)
class MessageStream:
    """The messages of a run in the order in which they are sent. lossless: pictures as PNG instead of JPEG.

    mount: as given; the one in use is sent, with the angles and the scale of the step before. static_mount: it is sent
    on /tf_static, with the first picture and where it changes, not with every picture on /tf (a recording, which may be
    played in part). robot_odom: where the robot publishes odom -> base itself, its pose there at a stamp in ROS time,
    s; only map -> odom is sent then, and nothing where it gives None. offset_s: from the stamps of frames to those of
    the messages.
    """

    intrinsics: Intrinsics | None = None
    mount: Mount | None = None
    frames: FrameIds = field(default_factory=FrameIds)
    lossless: bool = False
    static_mount: bool = False
    robot_odom: Callable[[float], SE2 | None] | None = None
    offset_s: float = 0.0
    _angled: Mount | None = None  # the given mount with the angles that the newest step used
    _sent: Mount | None = None  # the newest that was sent
    _steps: int = 0
    _last_stamp_s: float | None = None
    _grid: OccupancyGrid | None = None  # the newest that was sent
    _identity: MapIdentity | None = None  # of the map

    def picture(self, frame: Frame) -> Iterator[Outgoing]:
        """Lens, mount and picture of a frame."""
        stamp_ns = self._ns(frame)
        ids, lens, mount = self.frames, self.intrinsics, self.mount
        if lens is not None:
            yield Outgoing(topics.INFO, stamp_ns, lambda: build.camera_info(stamp_ns, lens, ids))
        if mount is not None:
            used = self._angled or mount
            if not self.static_mount or used != self._sent:
                topic, self._sent = topics.TF_STATIC if self.static_mount else topics.TF, used
                yield Outgoing(topic, stamp_ns, lambda: build.tf(build.mount_transform(stamp_ns, used, ids)))
        encoding = "png" if self.lossless else "jpeg"
        yield Outgoing(
            topics.PICTURES,
            stamp_ns,
            lambda: build.compressed_image(stamp_ns, encoded(frame, self.lossless), encoding, ids),
        )

    def step(self, result: StepResult, objects: list[MapObject]) -> Iterator[Outgoing]:
        """All messages of one step: its picture's and its results'."""
        yield from self.picture(result.frame)
        yield from self.results(result, objects)

    def results(self, result: StepResult, objects: list[MapObject]) -> Iterator[Outgoing]:
        """The messages of one step: poses, tf, boxes, the floor where it is new, and with the first and every
        `MAP_EVERY`th step the map."""
        stamp_ns, ids = self._ns(result.frame), self.frames
        self._identity = result.annotations.identity
        before_s, self._last_stamp_s = self._last_stamp_s, result.frame.stamp_s
        if (estimate := result.observed.mount_estimate) is not None:
            self._angled = estimate.used
        dt_s = 0.0 if before_s is None else result.frame.stamp_s - before_s
        yield Outgoing(topics.POSE, stamp_ns, lambda: build.pose(stamp_ns, result, ids))
        yield Outgoing(topics.ODOMETRY, stamp_ns, lambda: build.step_odometry(stamp_ns, result, dt_s, ids))
        pose_odom_base = (
            self.robot_odom(result.frame.stamp_s + self.offset_s) if self.robot_odom else result.pose_odom_base
        )
        if pose_odom_base is not None:
            pose_map_odom = result.pose_map_base @ pose_odom_base.inverse()
            transforms = [build.planar_transform(stamp_ns, ids.map, ids.odom, pose_map_odom)]
            if self.robot_odom is None:
                transforms.append(build.planar_transform(stamp_ns, ids.odom, ids.base, pose_odom_base))
            yield Outgoing(topics.TF, stamp_ns, lambda: build.tf(*transforms))
        yield self._boxes(result)
        if (scan := result.floor_scan) is not None:
            pictured_ns = self._ns(result.pictured)
            yield Outgoing(topics.FLOOR_SCAN, stamp_ns, lambda: scan_message(pictured_ns, scan, ids))
        if (grid := result.grid) is not None and grid is not self._grid:
            self._grid = grid
            yield Outgoing(topics.MAP, stamp_ns, lambda: grid_message(stamp_ns, grid, ids))
        self._steps += 1
        if self._steps % MAP_EVERY == 1:
            yield from self.map(stamp_ns, objects, result.pose_map_base)

    def last(self, result: StepResult, objects: list[MapObject]) -> Iterator[Outgoing]:
        """The boxes that came after the last frame, and the map with them."""
        yield self._boxes(result)
        yield from self.map(self._ns(result.frame), objects, result.pose_map_base)

    def _boxes(self, result: StepResult) -> Outgoing:
        stamp_ns, pictured_ns = self._ns(result.frame), self._ns(result.pictured)
        return Outgoing(topics.BOXES, stamp_ns, lambda: build.detections_2d(pictured_ns, result, self.frames))

    def _ns(self, frame: Frame) -> int:
        """Stamp of a frame's messages."""
        return to_ns(frame.stamp_s + self.offset_s)

    def map(self, stamp_ns: int, objects: list[MapObject], pose_map_base: SE2) -> Iterator[Outgoing]:
        """The objects on the map, for programs, for eyes, and as obstacles around the robot for planners."""
        yield Outgoing(topics.OBJECTS, stamp_ns, lambda: detections_3d(stamp_ns, objects, self.frames, self._identity))
        yield Outgoing(topics.MARKERS, stamp_ns, lambda: markers(stamp_ns, objects, self.frames))
        here = pose_map_base.x_m, pose_map_base.y_m
        yield Outgoing(topics.GRID, stamp_ns, lambda: grid_message(stamp_ns, live_grid(objects, *here), self.frames))


@lru_cache(maxsize=2)
def encoded(frame: Frame, lossless: bool = False) -> bytes:
    """A frame's picture as JPEG or PNG, encoded once for all that send it. Raises BridgeError."""
    return png(frame.image, quickly=True) if lossless else jpeg(frame.image, 90)
