"""The options of `edgemap run`, in the groups of its help."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from edgemap.cli.arguments import OptionError, arg
from edgemap.cli.groups import MappingOptions, MotionOptions, Source
from edgemap.cli.network_options import NetworkOptions
from edgemap.cli.options import (
    ConfigFile,
    ConfigOptions,
    DepthTopicName,
    ImuTopic,
    WheelTopic,
    WithoutDepth,
    above_zero,
    at_least,
)
from edgemap.cli.publishers import OutputGroup, WatchGroup, frame_names

if TYPE_CHECKING:
    from edgemap.runtime.frames.camera import SensorTopics
    from edgemap.runtime.step.map_store import MapPlace


@dataclass(frozen=True)
class CameraGroup(Source):
    """Source of the frames, intrinsics and mount."""

    without_depth: WithoutDepth = False
    depth_topic: DepthTopicName = None
    frames: Annotated[int | None, arg(metavar="N", help="Stop after N frames.")] = None
    realtime: Annotated[bool, arg(help="Pace files by their stamps, not at full speed.")] = False
    rate: Annotated[
        float | None,
        arg(
            metavar="HZ",
            help="Pictures a second that are searched for objects and floor, by their stamps; by default all. Every "
            "picture gives a motion. Saves processor time.",
        ),
    ] = None


@dataclass(frozen=True)
class RobotGroup(MotionOptions):
    """Source of the robot's motion."""

    wheel_topic: WheelTopic = None
    imu_topic: ImuTopic = None


@dataclass(frozen=True)
class SavedMapOptions:
    """A saved map to continue."""

    saved: Annotated[
        Path | None,
        arg(
            name="map",
            metavar="MAP",
            help="Continue a map. A name (home) or a folder opens it or makes a new one, and saves back into it; a "
            "map.json or a run folder is only read. Objects keep their ids. The run starts at the last pose or the "
            "dock where the objects agree, else the robot's place is found by its objects; --start sets it.",
        ),
    ] = None
    start: Annotated[
        str | None,
        arg(
            metavar="X,Y,YAW_DEG|dock|last",
            help="Where the robot starts in the map, to about 0.1 m and 3 degrees: metres forward and left, degrees "
            "counter-clockwise; dock: at the map's dock; last: where the last run ended.",
        ),
    ] = None
    forget: Annotated[
        Literal["auto", "on", "off"],
        arg(
            help="Whether an object that is in plain view and not detected, repeatedly, leaves the map; auto: on with "
            "--map, where furniture may have been moved since."
        ),
    ] = "auto"
    edited: Annotated[
        Path | None,
        arg(
            name="edits",
            metavar="FILE",
            help="Edits of an earlier run over the same source, taken at the same frames again: its edits.jsonl. A "
            "recording brings those of the run that recorded it.",
        ),
    ] = None

    def forgets(self, clustering: str) -> bool:
        """Whether the run weighs negative evidence. Raises OptionError for a map that cannot forget."""
        if self.forget == "on" and clustering == "paper":
            raise OptionError("--forget on: the paper's clustering keeps every sighting for good")
        return self.forget == "on" or (self.forget == "auto" and self.saved is not None)

    def place(self) -> "MapPlace | None":
        """The place of `--map`; None without it."""
        from edgemap.runtime.step.map_store import find_map

        return None if self.saved is None else find_map(self.saved)


@dataclass(frozen=True)
class MapGroup(MappingOptions, SavedMapOptions):
    """Objects to map, and the saved map to continue."""

    classes: Annotated[
        str | None,
        arg(metavar="A,B,…", help="Classes that go on the map, any that the bundle knows; by default those of homes."),
    ] = None


@dataclass(frozen=True)
class AdvancedGroup(NetworkOptions):
    """The network and tuned numbers."""

    config: ConfigFile = None
    config_options: ConfigOptions = False
    strict: Annotated[
        bool, arg(help="End at the first camera fault (a damaged picture, a late frame), not go on past it.")
    ] = False
    allow_untrained: Annotated[
        bool, arg(help="Run --odometry paper although its weights are untrained (its motion is noise).")
    ] = False


@dataclass(frozen=True)
class RunOptions:
    """All options of a run."""

    camera: CameraGroup
    robot: RobotGroup
    map: MapGroup
    watch: WatchGroup
    outputs: OutputGroup
    advanced: AdvancedGroup

    def check(self) -> None:
        """Read every text that needs nothing else, before anything is opened. Raises OptionError, and
        MissingExtraError where an output was asked for whose libraries are not installed."""
        from edgemap.cli.record import check_name
        from edgemap.runtime.frames.extras import need

        self.camera.check()
        self.robot.check()
        at_least(1, frames=self.camera.frames, threads=self.advanced.threads)
        self.map.check()
        frame_names(self.outputs.ros2_frames)
        check_name(self.outputs.recording)
        above_zero(rate=self.camera.rate)
        watch, out = self.watch, self.outputs
        asked = {"view": watch.view, "foxglove": watch.foxglove, "record": out.recording}
        asked |= {"mqtt": out.mqtt, "fleet": out.fleet, "ros2": out.ros2}
        for extra, value in asked.items():
            if value:
                need(extra, f"--{extra}")

    @property
    def pace_files(self) -> bool:
        """Whether file sources are paced by their stamps: on request, or because a live output follows the run."""
        return self.camera.realtime or self.watch.foxglove is not None or self.outputs.ros2

    @property
    def topics(self) -> "SensorTopics":
        """Further sensors among ROS 2 topics."""
        from edgemap.runtime.frames.camera import SensorTopics

        base = frame_names(self.outputs.ros2_frames)[3]
        return SensorTopics(self.robot.wheel_topic, self.robot.imu_topic, self.camera.depth_topic, base)

    def inputs(self) -> dict[str, object]:
        """Options that differ from their defaults and are inputs of the step, by flag, as plain values: what makes the
        same run again."""
        found: dict[str, object] = {}
        for group in (self.camera, self.robot, self.map, self.advanced):
            usual = type(group)()
            for name, value in vars(group).items():
                if name not in _NO_INPUTS and value != getattr(usual, name):
                    flag = _FLAGS.get(name, name.replace("_", "-"))
                    found[flag] = str(value) if isinstance(value, Path) else value
        return found


_NO_INPUTS = frozenset({"config", "config_options", "realtime"})
_FLAGS = {"saved": "map", "edited": "edits"}
