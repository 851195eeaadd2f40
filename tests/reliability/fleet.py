"""Hostile robots: messages of any numbers to a keeper, and one liar among honest robots in every merge."""

import json
import zlib
from dataclasses import replace
from pathlib import Path
from random import Random

import numpy as np

from edgemap.bridges.fleet.keeper import received_map
from edgemap.bridges.fleet.network import packed
from edgemap.geometry.map_object import MapObject
from edgemap.geometry.objects.place import MergeBudget, RobotMap, merge_place
from edgemap.geometry.se2 import SE2
from edgemap.runtime.step.map_file import map_document, read_map, save_map
from reliability.names import text
from reliability.parts import PartReport
from reliability.workers import INPUTS, ReaderCase, examine

ODD = (0, -1, 1, 0.5, 1e-12, 1e6, -1e6, 1e300, 1 << 29, 1 << 40, 1 << 70, None, True, "x", [], {})
LABELS = ("chair", "couch", "bed", "tv", "dining table")


def run(seed: int, share: float, out: Path) -> PartReport:
    """20,000 messages, 400 merges. out: failing inputs are kept here."""
    messages = examine(lambda _: [ReaderCase("messages", _message, _use_message)], seed, _count(share), out)
    merges = examine(lambda _: [ReaderCase("merges", _merge, _use_merge)], seed, _count(share / 50.0), out)
    figures = {"messages": messages.figures, "merges": merges.figures}
    failures = (*messages.failures, *(line for line in merges.failures if "first parse" not in line))
    return PartReport(failures, (*messages.table, "", *merges.table), figures)


def _count(share: float) -> int:
    return max(1, round(INPUTS * share))


def room(random: Random, count: int = 9) -> list[MapObject]:
    """Objects well apart."""
    places = [(x * 1.5, y * 1.5) for x in range(5) for y in range(4)]
    random.shuffle(places)
    return [
        MapObject(
            f"{LABELS[k % 5]}-{k}", LABELS[k % 5], np.array(place), np.eye(2) * 0.0144, 0.5, 0.9, 10, 0.9, 1.0, 2.0
        )
        for k, place in enumerate(places[:count])
    ]


def seen(objects: list[MapObject], random: Random) -> list[MapObject]:
    """The room as a robot maps it that began anywhere."""
    start = SE2(random.uniform(-5, 5), random.uniform(-5, 5), random.uniform(-3, 3)).inverse()
    noise = np.random.default_rng(random.randrange(1 << 30))
    return [replace(item, position_m=start.apply(item.position_m + noise.normal(0.0, 0.04, 2))) for item in objects]


def _message(random: Random) -> bytes:
    document = json.loads(json.dumps(map_document(seen(room(random), random))))
    for _ in range(random.randint(0, 3)):
        record = random.choice(document["objects"])
        name = random.choice(sorted(record))
        record[name] = random.choice((*ODD, text(random), [[random.choice(ODD)] * 2] * 2))
    if random.random() < 0.1:
        document["objects"] *= random.choice((2, 200, 5000))
    if random.random() < 0.1:
        document[random.choice(("zones", "deleted", "seen_from_m", "objects", "format"))] = random.choice(ODD)
    message = packed(document)
    kind = random.random()
    if kind < 0.05:
        return message[: random.randrange(len(message))]
    return zlib.compress(b"[" * random.randrange(1 << 20)) if kind < 0.07 else message


def _use_message(folder: Path, data: bytes) -> None:
    """As the keeper takes it, without a network."""
    objects, annotations = received_map(data, "map of robot")
    save_map(folder / "robot.json", objects, annotations)


def _merge(random: Random) -> tuple[list[list[MapObject]], list[MapObject], str]:
    objects = room(random, random.randint(6, 12))
    honest = [seen(objects, random) for _ in range(random.randint(3, 5))]
    kind = random.choice(("moves", "sure", "crowd", "copies", "far"))
    liar = list(honest[0])
    if kind == "crowd":
        places = [np.array([random.uniform(-9, 9), random.uniform(-9, 9)]) for _ in range(300)]
        liar = [replace(liar[0], id=f"chair-{k}", label="chair", position_m=at) for k, at in enumerate(places)]
    elif kind == "copies":
        liar = [replace(item, id=f"{item.id}{k}") for item in liar for k in range(5)]
    elif kind == "far":
        liar = [replace(item, position_m=item.position_m * random.choice((1e-6, 50.0))) for item in liar]
    else:
        liar = [
            replace(item, position_m=item.position_m + ([random.uniform(0.1, 0.9), 0.0] if k % 2 else [0.0, 0.0]),
                    covariance_m2=np.eye(2) * (1e-6 if kind == "sure" else 0.01), count=1 << 20)
            for k, item in enumerate(liar)
        ]  # fmt: skip
    return honest, liar, kind


def _use_merge(folder: Path, data: tuple[list[list[MapObject]], list[MapObject], str]) -> None:
    honest, liar, _ = data
    maps = {f"robot{k}": RobotMap(f"key{k}", tuple(objects)) for k, objects in enumerate(honest)}
    before = merge_place(maps, budget=MergeBudget())
    joined = {name for name, member in before.members.items() if member.pose_place_map is not None}
    place = merge_place(
        {**maps, "stranger": RobotMap("lies", tuple(liar))}, budget=MergeBudget(arrived={"stranger": 1})
    )
    still = {name for name, member in place.members.items() if member.pose_place_map is not None}
    assert joined <= still, f"{joined - still} are no longer in the place"
    read_map(json.dumps(map_document(list(place.objects), place.annotations)).encode(), "the place")
    for item in before.objects:
        nearest_m = min(float(np.linalg.norm(item.position_m - other.position_m)) for other in place.objects)
        assert nearest_m < 0.4, f"an object of {len(joined)} robots moved by {nearest_m:.2f} m"
