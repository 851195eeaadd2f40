"""`edgemap fleet serve` and `edgemap fleet show`, and the fleet's options of `edgemap run`."""

from typing import TYPE_CHECKING

from edgemap.cli.errors import OptionError
from edgemap.cli.publishers import host_and_port

if TYPE_CHECKING:
    from pathlib import Path

    from edgemap.runtime.outputs.fleet.sink import FleetSink

LOCAL = "127.0.0.1"


def place_and_address(text: str, option: str) -> tuple[str, str]:
    """`PLACE`, and the address after its `@` for zenoh. Raises OptionError."""
    from edgemap.runtime.outputs.fleet.network import PORT

    place, at, host = text.partition("@")
    return place, address(host if at else LOCAL, option, PORT)


def address(text: str, option: str, port: int) -> str:
    """HOST:PORT as zenoh writes it. Raises OptionError."""
    host, number = host_and_port(text, option, port)
    return f"[{host}]:{number}" if ":" in host else f"{host}:{number}"


def fleet_sink(fleet: str, robot: str | None, saved: "Path | None") -> "FleetSink":
    """The sink of `--fleet`. Raises OptionError, PublishError or MissingExtraError."""
    import socket

    from edgemap.runtime.outputs.fleet.access import SECRET, robot_of_environment
    from edgemap.runtime.outputs.fleet.sink import FleetSink

    if saved is not None and _of_a_fleet(saved):
        raise OptionError(
            f"--map {saved} is merged from robots of a fleet: with --fleet what they saw would count twice; go on with "
            "this robot's own map"
        )
    place, where = place_and_address(fleet, "--fleet")
    named = robot_of_environment()
    if named and robot and robot != named:
        raise OptionError(f"--robot {robot}: {SECRET} is that of the robot {named}")
    return FleetSink(place, named or robot or socket.gethostname(), where)


def _of_a_fleet(saved: "Path") -> bool:
    from edgemap.runtime.frames.reading import read_bytes
    from edgemap.runtime.step.map_file import MAP_BYTES

    path = saved / "map.json" if saved.is_dir() else saved
    return b'"pose_place_map"' in read_bytes(path, MAP_BYTES, OptionError)
