"""`edgemap fleet serve`: keeps the merged map of a place."""

import contextlib
import os
import time
from math import degrees
from pathlib import Path
from typing import Annotated

import tyro

from edgemap.cli.arguments import OptionError, arg
from edgemap.cli.publishers import address, place_and_address

LAST_S = 1.0  # for the merge after the signal to end; the robots' own maps are kept in any case


def command(
    place: Annotated[
        tyro.conf.Positional[str],
        arg(metavar="PLACE[@HOST[:PORT]]", help="Its name; with HOST: meet the robots at the zenoh router there."),
    ],
    *,
    out: Annotated[Path | None, arg(aliases=["-o"], metavar="DIR", help="Its folder; PLACE by default.")] = None,
    listen: Annotated[
        str,
        arg(
            metavar="HOST[:PORT]",
            help="Address for the robots to connect to; 0.0.0.0 for every network. Without --robots, or "
            "EDGEMAP_FLEET_SECRET set to the same text here and on the robots, everybody who reaches it is let in.",
        ),
    ] = "127.0.0.1:7447",
    robots: Annotated[
        Path | None,
        arg(
            metavar="FILE",
            help="A password for each robot, lines of NAME:PASSWORD; the robot has its line in EDGEMAP_FLEET_SECRET. "
            "Each then sends under its own name alone, so that no robot can invent others (docs/fleet.md).",
        ),
    ] = None,
    reference: Annotated[
        Path | None,
        arg(
            name="map",
            metavar="SAVED",
            help="A map of the place made before: its frame is the place's, it is merged too.",
        ),
    ] = None,
    every: Annotated[float, arg(metavar="S", help="Seconds between two merges.")] = 2.0,
) -> None:
    """Keep one map of a place from the latest map of each robot that runs with `--fleet PLACE`, until Ctrl-C.

    DIR/map.json is the merged map, written atomically; DIR/robots/NAME.json the latest map of each. Maps are aligned
    by their objects, as `map merge` does; one that fits nowhere with certainty stays apart, with the reason, until it
    does. A robot that is away stays in the map; when it is back its new map takes the place of its old one.
    """
    import resource

    from edgemap.bridges.fleet.access import access_is_limited, read_passwords
    from edgemap.bridges.fleet.keeper import PlaceKeeper
    from edgemap.bridges.fleet.network import PORT
    from edgemap.geometry.errors import MapError
    from edgemap.runtime.frames.errors import DiskError
    from edgemap.runtime.frames.extras import need
    from edgemap.runtime.step.loop import stop_on_signals

    need("fleet", "edgemap fleet serve")  # before the folder is made
    if not 0.1 <= every <= 3600.0:
        raise OptionError(f"--every {every:g}: 0.1 to 3600 s")
    name, router = place_and_address(place, "PLACE")
    through_router = "@" in place
    if robots is not None and (through_router or os.environ.get("ZENOH_CONFIG")):
        raise OptionError("--robots: who may send is decided by the router, or by the file of ZENOH_CONFIG")
    folder = out or Path(name)
    own = "" if through_router else address(listen, "--listen", PORT)
    # Each connection is an open file: beyond the usual soft limit of 1024 no map could be written.
    hard = resource.getrlimit(resource.RLIMIT_NOFILE)[1]
    with contextlib.suppress(ValueError, OSError):  # the kernel allows fewer
        resource.setrlimit(resource.RLIMIT_NOFILE, (hard, hard))
    with stop_on_signals() as stop:
        passwords = read_passwords(robots) if robots else None
        keeper = PlaceKeeper(name, folder, router if through_router else "", own, reference, passwords)
        try:
            print(f"map of {name}: {folder}/map.json", flush=True)
            print(f"robots:  edgemap run --fleet {name}@{router if through_router else own} --robot NAME", flush=True)
            if own and not own.startswith(("127.", "[::1]", "localhost")) and not passwords and not access_is_limited():
                print(
                    "everybody who reaches this port may send maps under any name; --robots FILE limits it", flush=True
                )
            printed: dict[str, str] = {}
            strangers: dict[str, str] = {}
            while not stop.is_set():
                try:
                    keeper.update(stop.is_set)
                except DiskError:
                    raise
                except MapError as error:
                    printed = _print_changes(printed, printed | {"": str(error)})
                else:
                    printed = _print_changes(printed, lines(keeper.document()["fleet"]["robots"]))
                strangers = _print_changes(strangers, {line: line for line in list(keeper.strangers)})
                stop.wait(every)
            until_s = time.monotonic() + LAST_S
            keeper.update(lambda: time.monotonic() > until_s)
        finally:
            keeper.close()


def _print_changes(before: dict[str, str], now: dict[str, str]) -> dict[str, str]:
    for name, line in now.items():
        if before.get(name) != line:
            print(line, flush=True)
    return now


def lines(robots: dict) -> dict[str, str]:
    """One line about each robot, of the document's `fleet.robots`."""
    found = {}
    for name, robot in robots.items():
        here = "" if robot["here"] else ", away"
        if robot.get("apart"):
            state = f"apart: {robot['apart']}"
        else:
            x_m, y_m, yaw_rad = robot["pose_place_map"]
            matched = f"{robot['pairs']} of {robot.get('shared', 0)} matched" if robot.get("pairs") else "first"
            state = f"{matched}, its frame at x {x_m:.2f} m, y {y_m:.2f} m, yaw {degrees(yaw_rad):.0f} deg"
        refused = f"; refused: {robot['refused']}" if robot.get("refused") else ""
        found[name] = f"{name:<16} {robot['objects']:4d} objects{here}; {state}{refused}"
    return found
