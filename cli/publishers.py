"""`edgemap run`'s live outputs to other programs: their options, and the sinks that they open."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from edgemap.cli.arguments import arg, may_be_left_out
from edgemap.cli.errors import OptionError

if TYPE_CHECKING:
    from edgemap.geometry.camera.floor import FloorCamera
    from edgemap.runtime.step.sinks import Sink

Foxglove = Annotated[
    str | None,
    may_be_left_out("HOST:PORT", "127.0.0.1:8765"),
    arg(
        help="Serve pictures, boxes, poses and the map to Foxglove (extra foxglove); 127.0.0.1:8765 where HOST:PORT is "
        "left out. Files are then paced by their stamps. There is no password: 0.0.0.0 only in networks you trust."
    ),
]
Rerun = Annotated[
    str | None,
    may_be_left_out("FILE.rrd|HOST[:PORT]", "127.0.0.1:9876"),
    arg(
        help="Send pictures, boxes, poses and the map to a Rerun viewer (extra rerun), on this machine where HOST is "
        "left out, or write them into FILE.rrd."
    ),
]
RerunPictures = Annotated[
    float, arg(metavar="HZ", help="With --rerun: pictures and their boxes so often at most; they cost most of it.")
]
MqttBroker = Annotated[
    str | None,
    arg(
        metavar="HOST[:PORT]",
        help="Publish the robot's state and the objects that appear, move and vanish to an MQTT broker (extra mqtt); "
        "Home Assistant discovers the robot. User and password: EDGEMAP_MQTT_USER and EDGEMAP_MQTT_PASSWORD.",
    ),
]
RobotName = Annotated[
    str | None,
    arg(
        metavar="NAME",
        help="The robot's name, with --mqtt (topics edgemap/NAME/…) and --fleet; by default the machine's.",
    ),
]


def open_publishers(
    floor: FloorCamera, foxglove: str | None, rerun: str | None, pictures_hz: float, mqtt: str | None, robot: str | None
) -> list[Sink]:
    """The sinks that were asked for. Raises MissingExtraError, or PublishError where one cannot be opened."""
    from edgemap.runtime.outputs.messages.stream import MessageStream

    sinks: list[Sink] = []
    if foxglove is not None:
        from edgemap.runtime.outputs.publishers.foxglove import FoxgloveServer

        server = FoxgloveServer(
            *host_and_port(foxglove, "--foxglove", 8765), MessageStream(floor.intrinsics, floor.mount)
        )
        print(f"Foxglove:  {server.url}", flush=True)
        sinks.append(server)
    if rerun is not None:
        from edgemap.runtime.outputs.publishers.rerun import RerunStream

        if not 0.0 < pictures_hz <= 1000.0:
            raise OptionError(f"--rerun-pictures {pictures_hz:g}: more than 0 and at most 1000 a second")
        target = Path(rerun) if rerun.endswith(".rrd") else host_and_port(rerun, "--rerun", 9876)
        sinks.append(RerunStream(target, MessageStream(floor.intrinsics, floor.mount), pictures_hz))
    if mqtt is not None:
        import os
        import socket

        from edgemap import __version__
        from edgemap.runtime.outputs.publishers.mqtt import MqttPublisher

        user, password = (os.environ.get(f"EDGEMAP_MQTT_{name}") for name in ("USER", "PASSWORD"))
        host, port = host_and_port(mqtt, "--mqtt", 1883)
        sinks.append(MqttPublisher(host, port, robot or socket.gethostname(), user, password, __version__))
    return sinks


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
