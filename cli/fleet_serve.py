"""`edgemap fleet serve`: keeps the merged map of a place."""

from math import degrees
from pathlib import Path
from typing import Annotated

import tyro

from edgemap.cli.arguments import arg
from edgemap.cli.signals import stop_on_signals
from edgemap.geometry.errors import EdgemapError
from edgemap.runtime.frames.errors import UsageError
from edgemap.runtime.frames.extras import need


def command(
    place: Annotated[tyro.conf.Positional[str], arg(metavar="PLACE[@HOST]", help="Its name; HOST: a zenoh router.")],
    *,
    out: Annotated[Path | None, arg(aliases=["-o"], metavar="DIR", help="Its folder; PLACE by default.")] = None,
    listen: Annotated[
        str, arg(metavar="HOST[:PORT]", help="Where robots connect; 0.0.0.0: from everywhere (access: docs/fleet.md).")
    ] = "127.0.0.1:7447",
    reference: Annotated[
        Path | None, arg(name="map", metavar="SAVED", help="A map made before: its frame counts, it is merged too.")
    ] = None,
    every: Annotated[float, arg(metavar="S", help="Seconds between two merges.")] = 2.0,
) -> None:
    """Keep one map of a place from the latest map of each robot that runs with `--sink fleet:PLACE`, until Ctrl-C.

    DIR/map.json is the merged map, DIR/robots/NAME.json the latest map of each robot. Maps are aligned by their
    objects and floors, as `map merge` does; one that does not fit with certainty stays apart, with the reason, until it
    does.
    """
    from edgemap.bridges.fleet.keeper import PlaceKeeper
    from edgemap.bridges.fleet.network import place_and_address, zenoh_address

    need("fleet", "edgemap fleet serve")  # before the folder is made
    if not 0.1 <= every <= 3600.0:
        raise UsageError(f"--every {every:g}: 0.1 to 3600 s")
    name, router = place_and_address(place, "PLACE")
    local = "" if "@" in place else zenoh_address(listen, "--listen")
    with stop_on_signals() as stop:
        keeper = PlaceKeeper(name, out or Path(name), "" if local else router, local, reference)
        print(f"map of {name}: {out or name}/map.json")
        print(f"robots:  EDGEMAP_ROBOT=NAME edgemap run --sink fleet:{name}@{local or router}", flush=True)
        printed: set[str] = set()
        try:
            while not stop.wait(every):
                try:
                    current = {state_line(*robot) for robot in keeper.update().items()}
                except EdgemapError as error:
                    current = {str(error)}
                print(*(f"{line}\n" for line in sorted(current - printed)), sep="", end="", flush=True)
                printed = current
            keeper.update()
        finally:
            keeper.close()


def state_line(name: str, robot: dict) -> str:
    """A robot's entry in `fleet.robots` in one line."""
    state = f"apart: {robot.get('apart')}"
    if "pose_place_map" in robot:
        x_m, y_m, yaw_rad = robot["pose_place_map"]
        matched = f"{robot['pairs']} of {robot['shared']} matched"
        state = f"{matched}, its frame at x {x_m:.2f} m, y {y_m:.2f} m, yaw {degrees(yaw_rad):.0f} deg"
    state += f"; refused: {robot['refused']}" if "refused" in robot else ""
    return f"{name:<16} {robot['objects']:4d} objects{'' if robot['here'] else ', away'}; {state}"
