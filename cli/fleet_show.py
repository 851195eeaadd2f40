"""`edgemap fleet show`: the merged map of a place, and its robots, as they are now."""

from json import dumps, loads
from pathlib import Path
from typing import Annotated

import tyro

from edgemap.cli.arguments import arg
from edgemap.cli.options import Json
from edgemap.runtime.frames.disk import write_atomically
from edgemap.runtime.frames.errors import BridgeError
from edgemap.runtime.frames.reading import printable


def command(
    place: Annotated[tyro.conf.Positional[str], arg(metavar="PLACE[@HOST]", help="Its name; HOST: of its keeper.")],
    *,
    out: Annotated[Path | None, arg(aliases=["-o"], metavar="FILE.json", help="Save the merged map.")] = None,
    json: Json = False,
) -> None:
    """Ask who keeps the map of a place for it: which robots are in it, where they are, which stay apart and why."""
    from edgemap.bridges.fleet.network import ROOT, checked_name, open_session, place_and_address
    from edgemap.cli.fleet_serve import state_line
    from edgemap.runtime.step.grid_file import grid_name, read_grid, save_grid
    from edgemap.runtime.step.map_file import read_map

    name, where = place_and_address(place, "PLACE")
    session = open_session(connect=where, wait_s=5.0)
    try:
        replies = session.get(f"{ROOT}/{checked_name(name, 'place')}/map", timeout=5.0)
        answer = next((reply.ok for reply in replies if reply.ok is not None), None)
    finally:
        session.close()
    if answer is None:
        raise BridgeError(f"nobody keeps the map of {name} at {where} (no answer within 5 s)")
    objects, _ = read_map(text := answer.payload.to_bytes(), f"map of {name}")
    document = loads(text)
    if out is not None:
        if grid := answer.attachment and answer.attachment.to_bytes():
            save_grid(out.with_name(grid_name(out)), read_grid(grid, f"grid of {name}"))
            document["grid"] = grid_name(out)
        write_atomically(out, dumps(document, indent=1) + "\n")
    if json:
        print(text.decode())
        return
    for identity, robot in document["fleet"]["robots"].items():
        at = "; robot at x {:.2f} m, y {:.2f} m".format(*robot["pose_place_base"]) if "pose_place_base" in robot else ""
        print(printable(state_line(identity, robot) + at))
    print(f"{len(objects)} objects in {name}" + (f", saved in {out}" if out else ""))
