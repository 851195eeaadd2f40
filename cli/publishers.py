"""Options of what a run shows and writes."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from edgemap.cli.arguments import arg, may_be_left_out


@dataclass(frozen=True)
class WatchGroup:
    """See the run while it lasts."""

    view: Annotated[
        str | None,
        may_be_left_out("HOST:PORT[,without-pictures]", "127.0.0.1:8090"),
        arg(
            help="Serve a live page for browsers, on 127.0.0.1:8090 where HOST:PORT is left out; port 0: any free one. "
            "0.0.0.0 serves every network: beyond this machine viewers need the token that is printed with the page's "
            "address. Files are then paced by their stamps, as --realtime does, and the page stays after the last "
            "frame until Ctrl-C. without-pictures: the map alone, nothing of the camera's pictures."
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
    sink: Annotated[
        str | None,
        arg(
            metavar="NAME[:ADDRESS],…",
            help="Send the results to sinks of installed packages (docs/plugins.md). "
            "fleet:PLACE[@HOST[:PORT]]: to the keeper of a place (extra fleet, docs/fleet.md).",
        ),
    ] = None
