"""What a run shows and writes: the options, and the sinks of other programs; addresses, also of a fleet."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from edgemap.cli.arguments import OptionError, arg, may_be_left_out
from edgemap.cli.options import words_of

if TYPE_CHECKING:
    from edgemap.bridges.fleet.sink import FleetSink
    from edgemap.bridges.ros2.sink import Ros2Options, Ros2Sink
    from edgemap.geometry.camera.floor import FloorCamera
    from edgemap.runtime.frames.camera import Camera
    from edgemap.runtime.step.edit_queue import Edits
    from edgemap.runtime.step.sinks import Sink


LOCAL = "127.0.0.1"


@dataclass(frozen=True)
class WatchGroup:
    """See the run while it lasts."""

    view: Annotated[
        str | None,
        may_be_left_out("HOST:PORT", "127.0.0.1:8090"),
        arg(
            help="Serve a live page for browsers, on 127.0.0.1:8090 where HOST:PORT is left out; port 0: any free one. "
            "0.0.0.0 serves every network: beyond this machine viewers need the token that is printed with the page's "
            "address. Files are then paced by their stamps, as --realtime does, and the page stays after the last "
            "frame until Ctrl-C."
        ),
    ] = None
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
        str | None,
        arg(
            name="record",
            metavar="[lossless:]FILE.mcap",
            help="Record pictures and results, to be replayed. lossless: PNG, not JPEG, so that a replay gives the "
            "very same map.",
        ),
    ] = None
    mqtt: Annotated[
        str | None,
        arg(
            metavar="HOST[:PORT]",
            help="Publish the robot's state and the objects that appear, move and vanish to an MQTT broker (extra "
            "mqtt), topics edgemap/NAME/…; Home Assistant discovers the robot. Variables: EDGEMAP_ROBOT (NAME, by "
            "default the machine's), EDGEMAP_MQTT_USER and EDGEMAP_MQTT_PASSWORD.",
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
    ros2: Annotated[
        str | None,
        may_be_left_out("NAME=VALUE,…", ""),
        arg(
            help="Publish results live as ROS 2 topics (docs/ros2.md): namespace=NAME before every topic but tf "
            "(edgemap), map=, odom=, base=, optical=FRAME, pictures=yes (JPEG), reliable=no (boxes and pictures best "
            "effort, for lossy radio), odom_tf=no (the robot publishes odom -> base itself). Files are then paced by "
            "their stamps. ROS_DOMAIN_ID and the other variables of ROS 2 say who may find them: programs on this "
            "machine where none is set."
        ),
    ] = None

    def recorded(self) -> tuple[Path | None, bool]:
        """The file of `--record`, and whether it is lossless."""
        name = (self.recording or "").removeprefix("lossless:")
        return (Path(name) if name else None), name != self.recording

    def named_sinks(self, saved: Path | None) -> "list[Sink]":
        """The sinks that were asked for. saved: the map that the run continues. Raises OptionError, PublishError or
        MissingExtraError.
        """
        import os

        sinks: list[Sink] = []
        if self.mqtt is not None:
            from edgemap import __version__
            from edgemap.bridges.mqtt.sink import MqttPublisher

            user, password = (os.environ.get(f"EDGEMAP_MQTT_{name}") for name in ("USER", "PASSWORD"))
            host, port = host_and_port(self.mqtt, "--mqtt", 1883)
            sinks.append(MqttPublisher(host, port, robot_name(), user, password, __version__))
        if self.fleet is not None:
            sinks.append(fleet_sink(self.fleet, saved))
        return sinks

    def ros2_sinks(self, source: "Camera", floor: "FloorCamera", edits: "Edits") -> "list[Ros2Sink]":
        """The sink that publishes, where it is asked for. Raises OptionError, Ros2Error or MissingExtraError."""
        if self.ros2 is None:
            return []
        from edgemap.bridges.ros2.dds.node import shared_node
        from edgemap.bridges.ros2.sink import Ros2Sink

        return [
            Ros2Sink(
                shared_node(),
                floor,
                ros2_options(self.ros2),
                ros_time=source.name.startswith("ros2:"),
                edit=edits.submit,
            )
        ]


def ros2_options(text: str) -> "Ros2Options":
    """How `--ros2 TEXT` publishes. Raises OptionError."""
    from dataclasses import fields

    from edgemap.bridges.ros2.messages.topics import FrameIds
    from edgemap.bridges.ros2.sink import NAMESPACE, Ros2Options

    switches, frames = ("pictures", "reliable", "odom_tf"), [field.name for field in fields(FrameIds)]
    words = words_of(text, "--ros2", {"namespace", *switches, *frames})
    if wrong := [f"{name}={words[name]}" for name in switches if words.get(name, "yes") not in ("yes", "no")]:
        raise OptionError(f"--ros2 {wrong[0]}: expected yes or no")
    ids = FrameIds(**{name: words[name] for name in frames if name in words})
    names = [getattr(ids, name) for name in frames]
    if len(set(names)) != len(names):
        raise OptionError(f"--ros2 {text}: frames {', '.join(names)} must be different")
    on = {name: words.get(name, usual) == "yes" for name, usual in (("pictures", "no"), ("reliable", "yes"))}
    own_tf = words.get("odom_tf", "yes") == "yes"
    return Ros2Options(words.get("namespace", NAMESPACE), ids, on["pictures"], not on["reliable"], own_tf)


def robot_name() -> str:
    """The robot's name for MQTT and the fleet: $EDGEMAP_ROBOT, else the machine's."""
    import os
    import socket

    return os.environ.get("EDGEMAP_ROBOT") or socket.gethostname()


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


def fleet_sink(fleet: str, saved: "Path | None") -> "FleetSink":
    """The sink of `--fleet`. Raises OptionError, PublishError or MissingExtraError."""
    from edgemap.bridges.fleet.sink import FleetSink

    if saved is not None and _of_a_fleet(saved):
        raise OptionError(
            f"--map {saved} is merged from robots of a fleet: with --fleet what they saw would count twice; go on with "
            "this robot's own map"
        )
    place, where = place_and_address(fleet, "--fleet")
    return FleetSink(place, robot_name(), where)


def _of_a_fleet(saved: "Path") -> bool:
    from edgemap.runtime.frames.reading import read_bytes
    from edgemap.runtime.step.map_file import MAP_BYTES

    path = saved / "map.json" if saved.is_dir() else saved
    return b'"pose_place_map"' in read_bytes(path, MAP_BYTES, OptionError)
