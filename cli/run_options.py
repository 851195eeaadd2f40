"""The options of `edgemap run`, in the groups of its help."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from edgemap.cli.arguments import arg
from edgemap.cli.budget import CpuShare
from edgemap.cli.fleet import Fleet
from edgemap.cli.groups import MotionOptions, NetworkOptions, Source
from edgemap.cli.options import Confidence, ConfigFile, ConfigOptions, LoopClosure, WithoutDepth, at_least, in_unit
from edgemap.cli.publishers import Foxglove, MqttBroker, Rerun, RerunPictures, RobotName
from edgemap.cli.ros2 import (
    FRAMES,
    DepthTopicName,
    ImuTopic,
    OdomTf,
    Ros2,
    Ros2BestEffort,
    Ros2Frames,
    Ros2Namespace,
    Ros2Pictures,
    WheelTopic,
    frame_names,
)
from edgemap.cli.saved_map import EditsFile, Forget, SavedMap, StartText

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
class MapGroup:
    """Objects to map, and the saved map to continue."""

    saved: SavedMap = None
    start: StartText = None
    forget: Forget = "auto"
    edited: EditsFile = None
    classes: Annotated[
        str | None,
        arg(metavar="A,B,…", help="Classes that go on the map, any that the bundle knows; by default those of homes."),
    ] = None
    confidence: Confidence = None
    clustering: Annotated[
        Literal["default", "paper"],
        arg(help="default: association under both covariances; paper: single linkage per label at 1 m."),
    ] = "default"
    loop_closure: LoopClosure = True


@dataclass(frozen=True)
class WatchGroup:
    """See the run while it lasts."""

    view: Annotated[
        bool,
        arg(
            help="Serve a live page for browsers. Files are then paced by their stamps, as --realtime does, and the "
            "page stays after the last frame until Ctrl-C."
        ),
    ] = False
    view_host: Annotated[
        str,
        arg(
            metavar="ADDRESS",
            help="Address to serve it on; 0.0.0.0 for every network. Beyond this machine viewers need the token that "
            "is printed with the page's address.",
        ),
    ] = "127.0.0.1"
    view_port: Annotated[int, arg(metavar="PORT", help="Port to serve it on; 0 for any free one.")] = 8090
    foxglove: Foxglove = None
    rerun: Rerun = None
    rerun_pictures: RerunPictures = 1.0


@dataclass(frozen=True)
class OutputGroup:
    """Files, and other programs that get the results."""

    out: Annotated[
        Path | None, arg(aliases=["-o"], metavar="DIR", help="The run folder; runs/<UTC stamp>/ by default.")
    ] = None
    recording: Annotated[
        Path | None,
        arg(name="record", metavar="FILE.mcap", help="Record pictures and results, to be replayed."),
    ] = None
    lossless: Annotated[bool, arg(help="Record PNG, not JPEG: a replay gives the very same map.")] = False
    mqtt: MqttBroker = None
    fleet: Fleet = None
    robot: RobotName = None
    ros2: Ros2 = False
    ros2_pictures: Ros2Pictures = False
    ros2_best_effort: Ros2BestEffort = False
    ros2_namespace: Ros2Namespace = "edgemap"
    ros2_frames: Ros2Frames = FRAMES
    odom_tf: OdomTf = True


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
        """Read every text that needs nothing else, before anything is opened. Raises OptionError."""
        from edgemap.cli.budget import read_share
        from edgemap.cli.record import check_name

        self.camera.check()
        self.robot.check()
        at_least(1, frames=self.camera.frames, threads=self.advanced.threads)
        in_unit(confidence=self.map.confidence)
        frame_names(self.outputs.ros2_frames)
        check_name(self.outputs.recording)
        read_share(self.advanced.cpu)

    @property
    def budgeted(self) -> bool:
        """Whether the run stays within a share of the processor."""
        return self.advanced.cpu is not None

    @property
    def pace_files(self) -> bool:
        """Whether file sources are paced by their stamps: on request, or because a live output follows the run."""
        return self.camera.realtime or self.watch.foxglove is not None or self.outputs.ros2 or self.budgeted

    @property
    def topics(self) -> SensorTopics:
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
