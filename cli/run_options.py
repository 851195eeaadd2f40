"""The options of `edgemap run`, in the groups of its help."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from edgemap.cli.arguments import arg
from edgemap.cli.groups import MappingOptions, MotionOptions, Source
from edgemap.cli.network_options import NetworkOptions
from edgemap.cli.options import (
    ConfigFile,
    ConfigOptions,
    Topics,
    WithoutDepth,
    above_zero,
    at_least,
    listed,
    sensor_topics,
)
from edgemap.cli.publishers import OutputGroup, WatchGroup
from edgemap.runtime.frames.extras import need
from edgemap.runtime.frames.reading import without_secrets
from edgemap.runtime.step.map_store import AUTO, find_map

if TYPE_CHECKING:
    from edgemap.runtime.frames.camera import SensorTopics
    from edgemap.runtime.step.map_store import MapPlace


@dataclass(frozen=True)
class CameraGroup(Source):
    """Source of the frames, intrinsics and mount."""

    without_depth: WithoutDepth = False
    topics: Topics = None
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
class MapGroup(MappingOptions):
    """Objects to map, and the saved map to continue."""

    saved: Annotated[
        str | None,
        arg(
            name="map",
            metavar="MAP",
            help="Continue a map. A name (home) or a folder opens it or makes a new one, and saves back into it; a "
            "map.json or a run folder is only read. Objects keep their ids. The run starts at the last pose or the "
            "dock where the objects agree, else it is found by objects and floor; --start sets it. auto: the named map "
            "that objects and floor fit alone.",
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
    classes: Annotated[
        str | None,
        arg(metavar="A,B,…", help="Classes that go on the map, any that the bundle knows; by default those of homes."),
    ] = None

    def place(self) -> "MapPlace | None":
        """The place of `--map`; None without it, and for auto."""
        return None if self.saved is None or self.auto else find_map(self.saved)

    @property
    def auto(self) -> bool:
        """Whether the run finds out in which named map it is."""
        return self.saved == AUTO

    @property
    def named_classes(self) -> frozenset[str] | None:
        """The classes of `--classes`; None without it."""
        return None if self.classes is None else frozenset(listed(self.classes))


@dataclass(frozen=True)
class AdvancedGroup(NetworkOptions):
    """The network and tuned numbers."""

    config: ConfigFile = None
    config_options: ConfigOptions = False

    def repeated_edits(self) -> Path | None:
        """The edits of the run that `--config-options` repeats, where it has any."""
        if self.config is None or not self.config_options:
            return None
        folder = self.config if self.config.is_dir() else self.config.parent
        edits = folder / "edits.jsonl"
        return edits if edits.is_file() and (folder / "run.json").is_file() else None


@dataclass(frozen=True)
class RunOptions:
    """All options of a run."""

    camera: CameraGroup
    robot: MotionOptions
    map: MapGroup
    watch: WatchGroup
    outputs: OutputGroup
    advanced: AdvancedGroup

    def check(self) -> None:
        """Read every text that needs nothing else, before anything is opened. Raises UsageError, and
        MissingExtraError where an output was asked for whose libraries are not installed."""
        self.camera.check()
        self.robot.check()
        at_least(1, frames=self.camera.frames, threads=self.advanced.threads)
        self.map.check()
        above_zero(rate=self.camera.rate)
        asked = self.sinks
        for extra in ("foxglove", "record", "mqtt", "ros2"):
            if extra in asked:
                need(extra, f"--{extra}")
        if "fleet" in asked:
            need("fleet", "--sink fleet")
        if self.watch.view is not None:
            need("view", "--view")
        if "record" in asked:
            from edgemap.bridges.ros2.recordings.recorder import file_of
            from edgemap.cli.record import check_name

            check_name(file_of(asked["record"])[0])
        self.sensors()

    @property
    def sinks(self) -> dict[str, str]:
        """The sinks that were asked for, by name, each with its address."""
        outputs = self.outputs
        named = {"record": outputs.recording, "mqtt": outputs.mqtt, "ros2": outputs.ros2}
        named = {"foxglove": self.watch.foxglove} | named
        others = (text.partition(":") for text in (outputs.sink or "").split(",") if text)
        return {name: text for name, text in named.items() if text is not None} | {one[0]: one[2] for one in others}

    @property
    def pace_files(self) -> bool:
        """Whether file sources are paced by their stamps: on request, or because a live output follows the run."""
        return self.camera.realtime or self.watch.foxglove is not None or self.outputs.ros2 is not None

    def sensors(self) -> "SensorTopics":
        """Further sensors among ROS 2 topics. Raises UsageError."""
        if not self.outputs.ros2:
            return sensor_topics(self.camera.topics)
        from edgemap.bridges.ros2.sink import Ros2Options

        return sensor_topics(self.camera.topics, Ros2Options.of(self.outputs.ros2).frames.optical)

    def inputs(self) -> dict[str, object]:
        """Options that differ from their defaults and are inputs of the step, by flag, as plain values: what makes the
        same run again."""
        inputs: dict[str, object] = {}
        for group in (self.camera, self.robot, self.map, self.advanced):
            usual = type(group)()
            for name, value in vars(group).items():
                if name not in _NO_INPUTS and value != getattr(usual, name):
                    flag = _FLAGS.get(name, name.replace("_", "-"))
                    inputs[flag] = without_secrets(str(value)) if isinstance(value, Path | str) else value
        return inputs


_NO_INPUTS = frozenset({"config", "config_options", "realtime"})
_FLAGS = {"saved": "map"}
