"""`edgemap fleet show`: the merged map of a place, and its robots, as they are now."""

from pathlib import Path
from typing import Annotated

import tyro

from edgemap.cli.arguments import arg
from edgemap.cli.options import Json
from edgemap.cli.publishers import place_and_address


def command(
    place: Annotated[
        tyro.conf.Positional[str], arg(metavar="PLACE[@HOST[:PORT]]", help="Its name, and where its map is kept.")
    ],
    *,
    out: Annotated[
        Path | None, arg(aliases=["-o"], metavar="FILE.json", help="Save the merged map; `map show` draws it.")
    ] = None,
    json: Json = False,
) -> None:
    """Ask who keeps the map of a place for it: which robots are in it, where they are, which stay apart and why."""
    from edgemap.bridges.fleet.network import place_document
    from edgemap.cli.fleet_serve import lines
    from edgemap.runtime.frames.disk import write_atomically
    from edgemap.runtime.frames.reading import printable

    name, where = place_and_address(place, "PLACE")
    document, text = place_document(name, where)
    if out is not None:
        write_atomically(out, text)
    if json:
        print(text.decode())
        return
    robots = document["fleet"]["robots"]
    for identity, line in lines(robots).items():
        x_m, y_m, _ = robots[identity].get("pose_place_base") or (None, None, None)
        print(printable(line) + ("" if x_m is None else f"; robot at x {x_m:.2f} m, y {y_m:.2f} m"))
    print(f"{len(document['objects'])} objects in {name}" + (f", saved in {out}" if out else ""))
