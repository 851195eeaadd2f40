"""`python -m edgemap.benchmarks.agent HOME...`: what an agent hears over MCP about homes that the map's drive has seen.

HOME is a drive of `edgemap simulate`. Each is mapped with wheels, and questions are generated from its truth: where is
the CLASS of which the home has one, in which room is it, and where is the CLASS nearest to a place. A place is right
within 0.5 m of the true object; a room is right where it covers most of the true object's room of all rooms. Unknown is
what the map does not have, or marks as doubtful; `sure` counts what it is not sure of within 0.5 m as unknown too.
"""

import asyncio
import tempfile
from collections import Counter
from collections.abc import Iterator
from math import dist
from pathlib import Path
from typing import Any

import numpy as np
import tyro

from edgemap.benchmarks.boots import NEAR_M
from edgemap.evaluation.objects import TrueObject
from edgemap.geometry.grid.rooms import Room
from edgemap.geometry.map_object import as_places
from edgemap.geometry.objects.rooms import room_at, shared_m2

Question = tuple[str, dict[str, Any], list[tuple[float, float]]]  # tool, arguments, right places


def main(homes: tyro.conf.Positional[tuple[Path, ...]], bundle: str = "edgemap-nano", questions: int = 100) -> None:
    """Map, ask, score, print. homes: drives. questions: of all homes together."""
    total, share = Counter[str](), -(-questions // len(homes))
    for number, home in enumerate(homes):
        found = asyncio.run(asked(home, bundle, min(share, questions - number * share)))
        print(f"{home.name}: {dict(found)}", flush=True)
        total += found
    print(f"all {questions}: {dict(total)}")


async def asked(home: Path, bundle: str, count: int) -> Counter[str]:
    """The answers to that many questions about one home."""
    from mcp import Client

    from edgemap.benchmarks.map_variants import replayed, true_objects
    from edgemap.bridges.mcp.maps import open_source
    from edgemap.bridges.mcp.server import server
    from edgemap.evaluation.objects import scored
    from edgemap.runtime.inputs.drives import open_drive
    from edgemap.runtime.inputs.drives.truth import read_floor_plan
    from edgemap.runtime.network.bundle import load_bundle
    from edgemap.runtime.network.store import bundle_folder
    from edgemap.runtime.step.map_file import save_map
    from edgemap.runtime.step.slam import SlamOptions

    drive = open_drive(f"drive:{home}")
    slam = replayed(drive, load_bundle(bundle_folder(bundle)), {"own": SlamOptions()})["own"]
    truth, answers = scored(true_objects(drive)), Counter[str]()
    with tempfile.TemporaryDirectory() as folder:
        grid, plan = slam.mapper.grid.grid(), read_floor_plan(home)
        save_map(Path(folder) / "map.json", slam.objects(), slam.mapper.annotations(), grid)
        true_rooms = [Room("", as_places(room.corners_m)) for room in plan.rooms] if plan else []
        async with Client(server(open_source(folder))) as client:
            for tool, arguments, places in questions(truth, count):
                within = {} if tool == "room_of" else {"within_m": NEAR_M}
                result = await client.call_tool(tool, arguments | within)
                answer = result.structured_content or {}
                if tool == "room_of":
                    answers[f"room {room_verdict(list(answer.get('rooms', {}).values()), places[0], true_rooms)}"] += 1
                else:
                    rows = answer.get("objects", [])
                    answers[verdict(rows, places)] += 1
                    answers[f"sure {verdict(rows if rows and rows[0]['sure'] else [], places)}"] += 1
    return answers


def questions(truth: list[TrueObject], count: int) -> Iterator[Question]:
    """Questions in a random order that is always the same."""
    random, labels = np.random.default_rng(0), Counter(item.label for item in truth)
    single: list[Question] = [
        ("where_is", {"what": item.label}, [(item.x_m, item.y_m)]) for item in truth if labels[item.label] == 1
    ]
    single = single[: count // 4]
    yield from single
    yield from (("room_of", arguments, places) for _, arguments, places in single)
    for _ in range(count - 2 * len(single)):
        item = truth[random.integers(len(truth))]
        here = tuple((np.array([item.x_m, item.y_m]) + random.normal(0.0, 1.0, 2)).tolist())
        kin = sorted((dist(here, (one.x_m, one.y_m)), one.x_m, one.y_m) for one in truth if one.label == item.label)
        # Where two are about as near, either is right.
        places = [(x_m, y_m) for far_m, x_m, y_m in kin if far_m <= kin[0][0] + NEAR_M]
        asked_for = {"x_m": here[0], "y_m": here[1], "label": item.label, "radius_m": 5.0}
        yield "objects_near", asked_for, places


def verdict(rows: list[dict[str, Any]], places: list[tuple[float, float]]) -> str:
    """right, wrong or unknown, by the first answer."""
    if not rows or rows[0]["doubtful"]:
        return "unknown"
    return "right" if min(dist((rows[0]["x_m"], rows[0]["y_m"]), at) for at in places) <= NEAR_M else "wrong"


def room_verdict(rows: list[dict[str, Any] | None], at: tuple[float, float], true_rooms: list[Room]) -> str:
    """right, wrong or unknown, by the first answer. at: the true object."""
    if not rows or rows[0] is None:
        return "unknown"
    here = Room("", as_places(rows[0]["corners_m"]))
    best = max(true_rooms, key=lambda room: shared_m2(here, room))
    return "right" if room_at([best], at) else "wrong"


if __name__ == "__main__":
    tyro.cli(main, description=__doc__)
