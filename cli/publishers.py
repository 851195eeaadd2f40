"""What a run shows and writes: the options, and the sinks of other programs; addresses, also of a fleet."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from edgemap.cli.arguments import OptionError, arg, may_be_left_out

if TYPE_CHECKING:
    from edgemap.bridges.fleet.sink import FleetSink
    from edgemap.bridges.ros2.sink import Ros2Sink
    from edgemap.geometry.camera.floor import FloorCamera
    from edgemap.runtime.frames.camera import Camera
    from edgemap.runtime.step.edits import Edits
    from edgemap.runtime.step.sinks import Sink


LOCAL = "127.0.0.1"
FRAMES = "map,odom,base_link,camera_optical_frame"


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
    foxglove: Annotated[
        str | None,
        may_be_left_out("HOST:PORT", "127.0.0.1:8765"),
        arg(
            help="Serve pictures, boxes, poses and the map to Foxglove (extra foxglove); 127.0.0.1:8765 where "
            "HOST:PORT is left out. Files are then paced by their stamps. There is no password: 0.0.0.0 only in "
            "networks you trust."
        ),
    ] = None

    def viewer_sinks(self, floor: "FloorCamera") -> "list[Sink]":
        """The sinks that were asked for. Raises MissingExtraError, or PublishError where one cannot be opened."""
        from edgemap.bridges.ros2.messages.stream import MessageStream

        sinks: list[Sink] = []
        if self.foxglove is not None:
            from edgemap.bridges.foxglove.sink import FoxgloveServer

            host, port = host_and_port(self.foxglove, "--foxglove", 8765)
            server = FoxgloveServer(host, port, MessageStream(floor.intrinsics, floor.mount))
            print(f"Foxglove:  {server.url}", flush=True)
            sinks.append(server)
        return sinks


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
    mqtt: Annotated[
        str | None,
        arg(
            metavar="HOST[:PORT]",
            help="Publish the robot's state and the objects that appear, move and vanish to an MQTT broker (extra "
            "mqtt); Home Assistant discovers the robot. User and password: EDGEMAP_MQTT_USER and "
            "EDGEMAP_MQTT_PASSWORD.",
        ),
    ] = None
    fleet: Annotated[
        str | None,
        arg(
            metavar="PLACE[@HOST[:PORT]]",
            help="Send the map and the pose to the keeper of a place (fleet serve), on this machine without HOST "
            "(extra fleet, docs/fleet.md).",
        ),
    ] = None
    robot: Annotated[
        str | None,
        arg(
            metavar="NAME",
            help="The robot's name, with --mqtt (topics edgemap/NAME/…) and --fleet; by default the machine's.",
        ),
    ] = None
    ros2: Annotated[
        bool,
        arg(
            help="Publish results live as ROS 2 topics (docs/ros2.md). Files are then paced by their stamps, as "
            "--realtime does. ROS_DOMAIN_ID and the other variables of ROS 2 say who may find them: programs on this "
            "machine where none is set."
        ),
    ] = False
    ros2_pictures: Annotated[bool, arg(help="With --ros2: publish the pictures too (JPEG).")] = False
    ros2_best_effort: Annotated[
        bool, arg(help="With --ros2: boxes and pictures best effort, for lossy radio; reliable otherwise.")
    ] = False
    ros2_namespace: Annotated[str, arg(metavar="NAME", help="With --ros2: before every topic but tf.")] = "edgemap"
    ros2_frames: Annotated[
        str,
        arg(metavar="MAP,ODOM,BASE,CAMERA", help="With --ros2: names of the frames; the base is on the floor."),
    ] = FRAMES
    odom_tf: Annotated[
        bool,
        arg(
            help="With --ros2: --no-odom-tf where the robot itself publishes odom -> base; map -> odom builds on that."
        ),
    ] = True

    def named_sinks(self, saved: Path | None) -> "list[Sink]":
        """The sinks that were asked for. saved: the map that the run continues. Raises OptionError, PublishError or
        MissingExtraError.
        """
        import os
        import socket

        sinks: list[Sink] = []
        if self.mqtt is not None:
            from edgemap import __version__
            from edgemap.bridges.mqtt.sink import MqttPublisher

            user, password = (os.environ.get(f"EDGEMAP_MQTT_{name}") for name in ("USER", "PASSWORD"))
            host, port = host_and_port(self.mqtt, "--mqtt", 1883)
            sinks.append(MqttPublisher(host, port, self.robot or socket.gethostname(), user, password, __version__))
        if self.fleet is not None:
            sinks.append(fleet_sink(self.fleet, self.robot, saved))
        return sinks

    def ros2_sinks(self, source: "Camera", floor: "FloorCamera", edits: "Edits") -> "list[Ros2Sink]":
        """The sink that publishes, where it is asked for. Raises OptionError, Ros2Error or MissingExtraError."""
        if not self.ros2:
            return []
        from edgemap.bridges.ros2.dds.node import shared_node
        from edgemap.bridges.ros2.messages.topics import FrameIds
        from edgemap.bridges.ros2.sink import Ros2Options, Ros2Sink

        options = Ros2Options(
            self.ros2_namespace, FrameIds(*frame_names(self.ros2_frames)), self.ros2_pictures, self.ros2_best_effort,
            self.odom_tf,
        )  # fmt: skip
        return [Ros2Sink(shared_node(), floor, options, ros_time=source.name.startswith("ros2:"), edit=edits.submit)]


def frame_names(frames: str) -> list[str]:
    """The four frame names in the text of `--ros2-frames`. Raises OptionError."""
    names = [name.strip() for name in frames.split(",")]
    if len(names) != 4 or not all(names) or len(set(names)) != 4:
        raise OptionError(f"--ros2-frames {frames}: four different names, as in {FRAMES}")
    return names


def host_and_port(text: str, option: str, port: int) -> tuple[str, int]:
    """`HOST`, `HOST:PORT` or `[IPv6]:PORT`. port: the default. Raises OptionError."""
    host, colon, digits = text.rpartition(":")
    if not colon or text.endswith("]"):
        host, digits = text, str(port)
    host = host.removeprefix("[").removesuffix("]")
    if not host or not digits.isdecimal() or len(digits) > 5 or int(digits) > 65535:
        raise OptionError(f"{option} {text!r}: expected HOST or HOST:PORT with a port of 0 to 65535")
    try:
        host.encode("idna")  # as every connection does, on a thread of its own
    except UnicodeError as error:
        raise OptionError(f"{option} {text!r}: no name of a host ({error})") from None
    return host, int(digits)


def place_and_address(text: str, option: str) -> tuple[str, str]:
    """`PLACE`, and the address after its `@` for zenoh. Raises OptionError."""
    from edgemap.bridges.fleet.network import PORT

    place, at, host = text.partition("@")
    return place, address(host if at else LOCAL, option, PORT)


def address(text: str, option: str, port: int) -> str:
    """HOST:PORT as zenoh writes it. Raises OptionError."""
    host, number = host_and_port(text, option, port)
    return f"[{host}]:{number}" if ":" in host else f"{host}:{number}"


def fleet_sink(fleet: str, robot: str | None, saved: "Path | None") -> "FleetSink":
    """The sink of `--fleet`. Raises OptionError, PublishError or MissingExtraError."""
    import socket

    from edgemap.bridges.fleet.sink import FleetSink

    if saved is not None and _of_a_fleet(saved):
        raise OptionError(
            f"--map {saved} is merged from robots of a fleet: with --fleet what they saw would count twice; go on with "
            "this robot's own map"
        )
    place, where = place_and_address(fleet, "--fleet")
    return FleetSink(place, robot or socket.gethostname(), where)


def _of_a_fleet(saved: "Path") -> bool:
    from edgemap.runtime.frames.reading import read_bytes
    from edgemap.runtime.step.map_file import MAP_BYTES

    path = saved / "map.json" if saved.is_dir() else saved
    return b'"pose_place_map"' in read_bytes(path, MAP_BYTES, OptionError)
