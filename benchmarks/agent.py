"""`python -m edgemap.benchmarks.agent HOME...`: what an agent hears over MCP about homes that the map's drive has seen.

HOME is a drive of `edgemap simulate`. Each is mapped with wheels, and questions are generated from its truth: where is
the CLASS of which the home has one, and where is the CLASS nearest to a place. An answer is right within 0.5 m of the
true object, wrong elsewhere, and unknown where the map has none.
"""

import asyncio
import tempfile
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from math import dist
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tyro

from edgemap.benchmarks.boots import NEAR_M
from edgemap.evaluation.objects import TrueObject

Question = tuple[str, dict[str, Any], list[tuple[float, float]]]  # tool, arguments, right places


@dataclass(frozen=True)
class AgentOptions:
    """homes: drives. questions: of all homes together."""

    homes: Annotated[tuple[Path, ...], tyro.conf.Positional]
    bundle: str = "edgemap-nano"
    questions: int = 100


def main(options: AgentOptions) -> None:
    """Map, ask, score, print."""
    total: Counter[str] = Counter()
    share = -(-options.questions // len(options.homes))
    for home in options.homes:
        found = asyncio.run(asked(home, options, min(share, options.questions - total.total())))
        print(f"{home.name}: {dict(found)}", flush=True)
        total += found
    print(f"all {total.total()}: {dict(total)}")


async def asked(home: Path, options: AgentOptions, count: int) -> Counter[str]:
    """The answers to that many questions about one home."""
    from mcp import Client

    from edgemap.benchmarks.map_variants import replayed, true_objects
    from edgemap.bridges.mcp.maps import open_source
    from edgemap.bridges.mcp.server import server
    from edgemap.evaluation.objects import scored
    from edgemap.runtime.inputs.drives import open_drive
    from edgemap.runtime.network.bundle import load_bundle
    from edgemap.runtime.network.store import bundle_folder
    from edgemap.runtime.step.map_file import save_map
    from edgemap.runtime.step.slam import SlamOptions

    drive = open_drive(f"drive:{home}")
    slam = replayed(drive, load_bundle(bundle_folder(options.bundle)), {"own": SlamOptions()})["own"]
    truth, answers = scored(true_objects(drive)), Counter[str]()
    with tempfile.TemporaryDirectory() as folder:
        save_map(Path(folder) / "map.json", slam.objects(), slam.mapper.annotations())
        async with Client(server(open_source(folder))) as client:
            for tool, arguments, places in questions(truth, count):
                result = await client.call_tool(tool, arguments)
                rows = (result.structured_content or {}).get("objects", [])
                answers[verdict(rows, places)] += 1
    return answers


def questions(truth: list[TrueObject], count: int) -> Iterator[Question]:
    """Questions in a random order that is always the same."""
    random, labels = np.random.default_rng(0), Counter(item.label for item in truth)
    single: list[Question] = [
        ("where_is", {"what": item.label}, [(item.x_m, item.y_m)]) for item in truth if labels[item.label] == 1
    ]
    yield from single[: count // 2]
    for _ in range(count - len(single[: count // 2])):
        item = truth[random.integers(len(truth))]
        here = tuple((np.array([item.x_m, item.y_m]) + random.normal(0.0, 1.0, 2)).tolist())
        kin = sorted((dist(here, (one.x_m, one.y_m)), one.x_m, one.y_m) for one in truth if one.label == item.label)
        # Where two are about as near, either is right.
        places = [(x_m, y_m) for far_m, x_m, y_m in kin if far_m <= kin[0][0] + NEAR_M]
        asked_for = {"x_m": here[0], "y_m": here[1], "label": item.label, "radius_m": 5.0}
        yield "objects_near", asked_for, places


def verdict(rows: list[dict[str, Any]], places: list[tuple[float, float]]) -> str:
    """right, wrong or unknown, by the first answer."""
    if not rows:
        return "unknown"
    return "right" if min(dist((rows[0]["x_m"], rows[0]["y_m"]), at) for at in places) <= NEAR_M else "wrong"


if __name__ == "__main__":
    main(tyro.cli(AgentOptions, description=__doc__))
