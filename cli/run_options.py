"""The options of `edgemap run`, in the groups of its help."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from edgemap.cli.arguments import arg
from edgemap.cli.budget import CpuShare
from edgemap.cli.groups import MappingOptions, MotionOptions, NetworkOptions, Source
from edgemap.cli.live_page import PageOptions
from edgemap.cli.options import ConfigFile, ConfigOptions, WithoutDepth, at_least
from edgemap.cli.publishers import NamedOutputs, Viewers
from edgemap.cli.ros2 import DepthTopicName, ImuTopic, Ros2Outputs, WheelTopic, frame_names
from edgemap.cli.saved_map import SavedMapOptions

if TYPE_CHECKING:
    from edgemap.runtime.inputs.cameras.protocol import SensorTopics


@dataclass(frozen=True)
class CameraGroup(Source):
    """Source of the frames, intrinsics and mount."""

    without_depth: WithoutDepth = False
    depth_topic: DepthTopicName = None
    frames: Annotated[int | None, arg(metavar="N", help="Stop after N frames.")] = None
    realtime: Annotated[bool, arg(help="Pace files by their stamps, not at full speed.")] = False


@dataclass(frozen=True)
class RobotGroup(MotionOptions):
    """Source of the robot's motion."""

    wheel_topic: WheelTopic = None
    imu_topic: ImuTopic = None


@dataclass(frozen=True)
class MapGroup(MappingOptions, SavedMapOptions):
    """Objects to map, and the saved map to continue."""

    classes: Annotated[
        str | None,
        arg(metavar="A,B,…", help="Classes that go on the map, any that the bundle knows; by default those of homes."),
    ] = None


@dataclass(frozen=True)
class WatchGroup(Viewers, PageOptions):
    """See the run while it lasts."""


@dataclass(frozen=True)
class Files:
    """Files that a run writes."""

    out: Annotated[
        Path | None, arg(aliases=["-o"], metavar="DIR", help="The run folder; runs/<UTC stamp>/ by default.")
    ] = None
    recording: Annotated[
        Path | None,
        arg(name="record", metavar="FILE.mcap", help="Record pictures and results, to be replayed."),
    ] = None
    lossless: Annotated[bool, arg(help="Record PNG, not JPEG: a replay gives the very same map.")] = False


@dataclass(frozen=True)
class OutputGroup(Ros2Outputs, NamedOutputs, Files):
    """Files, and other programs that get the results."""


@dataclass(frozen=True)
class AdvancedGroup(NetworkOptions):
    """The network, tuned numbers and processor time."""

    config: ConfigFile = None
    config_options: ConfigOptions = False
    cpu: CpuShare = None
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
        from edgemap.cli.budget import read_share
        from edgemap.cli.record import check_name
        from edgemap.runtime.frames.extras import need

        self.camera.check()
        self.robot.check()
        at_least(1, frames=self.camera.frames, threads=self.advanced.threads)
        self.map.check()
        frame_names(self.outputs.ros2_frames)
        check_name(self.outputs.recording)
        read_share(self.advanced.cpu)
        watch, out = self.watch, self.outputs
        asked = {"view": watch.view, "foxglove": watch.foxglove, "rerun": watch.rerun, "record": out.recording}
        asked |= {"mqtt": out.mqtt, "fleet": out.fleet, "ros2": out.ros2}
        for extra, value in asked.items():
            if value:
                need(extra, f"--{extra}")

    @property
    def budgeted(self) -> bool:
        """Whether the run stays within a share of the processor."""
        return self.advanced.cpu is not None

    @property
    def pace_files(self) -> bool:
        """Whether file sources are paced by their stamps: on request, or because a live output follows the run."""
        return self.camera.realtime or self.watch.foxglove is not None or self.outputs.ros2 or self.budgeted

    @property
    def topics(self) -> "SensorTopics":
        """Further sensors among ROS 2 topics."""
        from edgemap.runtime.inputs.cameras.protocol import SensorTopics

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


_NO_INPUTS = frozenset({"config", "config_options", "realtime", "cpu"})
_FLAGS = {"saved": "map", "edited": "edits"}
