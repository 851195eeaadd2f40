"""`python -m edgemap.benchmarks.boots HOME...`: five boots on one map, furniture moved between them, clocks shifted.

HOME is a folder of five drives, 0 to 4, through one home: `edgemap simulate --seed S -o HOME/0`, then the same with
`--moved K -o HOME/K`. Each boot continues the named map of the boots before from an unknown pose. The host's clock is
right, missing, set on the way, or wrong at first. After each boot, every piece of furniture that the map has had is
asked for: where is it, and since when? An answer is wrong where the piece did not stand within 0.5 m of the place at
the first or last boot of which the answer speaks, or at one between that found its place in the map; a place, a time or
an object that the map does not state is unknown, and so is a place that it does not state to 0.5 m (95 %).
"""

import tempfile
from collections import Counter
from collections.abc import Callable, Iterable
from json import dumps, loads
from math import dist, radians
from pathlib import Path
from typing import Any

import numpy as np
import tyro

from edgemap.geometry.map_object import MapObject, ellipse_95
from edgemap.geometry.se2 import SE2
from edgemap.runtime.step.wall_clock import ClockReading

NEAR_M = 0.5
START_S, DAY_S = 1.8e9, 86400.0  # wall time of the first boot; one a day
LATE_S = 60.0  # after its start at which a boot has ended
Truth = dict[str, tuple[str, tuple[float, float]]]  # label and place by piece, in the first drive's frame


def main(homes: tyro.conf.Positional[tuple[Path, ...]], bundle: str = "edgemap-nano", json: bool = False) -> None:
    """Drive, ask, score, print. homes: folders of drives 0 to 4."""
    rows = {}
    for home in homes:
        row = rows[home.name] = boots(home, bundle)
        if not json:
            about = f"{row['answers']}; boots that found their place: {row['found']}"
            print("\n  ".join([f"{home.name}: {about}", *row["wrong"]]), flush=True)
    total: Counter[str] = sum((Counter(row["answers"]) for row in rows.values()), Counter())
    print(dumps({"homes": rows, "total": total}, indent=1) if json else f"all: {dict(total)}")


def clock(boot: int) -> Callable[[float], ClockReading]:
    """The host's clocks in a boot, by its stream's stamps: right; none; set after 20 s; wrong by 300 s until 10 s;
    right, in a stream that was suspended for 10 s."""
    start_s = START_S + boot * DAY_S
    known: list[Callable[[float], float | None]] = [
        lambda s: s, lambda _: None, lambda s: s if s > 20.0 else None, lambda s: s - 300.0 * (s < 10.0), lambda s: s,
    ]  # fmt: skip

    def read(stamp_s: float) -> ClockReading:
        past_s = stamp_s + (10.0 if boot == 4 and stamp_s > 15.0 else 0.0)
        now_s = known[boot % 5](past_s)
        return ClockReading(1000.0 * boot + past_s, None if now_s is None else start_s + now_s)

    return read


def boots(home: Path, bundle: str) -> dict[str, Any]:
    """Scores of one home."""
    answers: Counter[str] = Counter()
    wrong, found, known = list[str](), list[int](), dict[str, str]()
    drives = sorted(path for path in home.iterdir() if (path / "objects.json").is_file())
    truths = [truth_of(drive) for drive in drives]
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder) / "home"
        for boot, drive in enumerate(drives):
            if drive_once(drive, place, boot, bundle):
                found.append(boot)
            objects, gone = load(place)
            for piece, identity in list(known.items()):
                result, text = asked(piece, identity, objects, gone, truths[: boot + 1], found)
                answers[result] += 1
                wrong += [f"boot {boot}: {text}"] if result == "wrong" else []
            for item in objects.values():
                if item.id not in known.values() and (piece := nearest(item, truths[boot])) not in (None, *known):
                    known[str(piece)] = item.id
    return {"answers": answers, "wrong": wrong, "found": found, "pieces": len(known)}


def drive_once(drive: Path, place: Path, boot: int, bundle: str) -> bool:
    """One boot; whether it found its place in the map."""
    from edgemap.geometry.camera.floor import FloorCamera
    from edgemap.runtime.compose import RunSpec, compose
    from edgemap.runtime.inputs.open import open_camera
    from edgemap.runtime.network.bundle import load_bundle
    from edgemap.runtime.network.store import bundle_folder
    from edgemap.runtime.outputs.sinks.living_map import LivingMap
    from edgemap.runtime.step.loop import steps

    with open_camera(f"drive:{drive}") as camera:
        lens, mount = camera.info.intrinsics, camera.info.mount
        if lens is None or mount is None:
            raise SystemExit(f"{drive}: no intrinsics or no mount")
        slam = compose(camera, load_bundle(bundle_folder(bundle)), FloorCamera(lens, mount), RunSpec(map=place))
        slam.clock = clock(boot)
        sink = LivingMap(place, lambda: slam.mapper.searching)
        for _ in steps(camera, slam, [sink]):
            pass
        sink.release()
    return not slam.mapper.searching


def truth_of(drive: Path) -> Truth:
    """The pieces of a drive's home, in the first drive's frame, of which moved.json has this one's start."""
    path = drive / "moved.json"
    x_m, y_m, yaw_deg = loads(path.read_text())["start"] if path.is_file() else (0.0, 0.0, 0.0)
    pose, records = SE2(x_m, y_m, radians(yaw_deg)), loads((drive / "objects.json").read_text())["objects"]
    places = {str(one["id"]): (one["label"], pose.apply(np.array([one["x_m"], one["y_m"]]))) for one in records}
    return {piece: (label, (float(at[0]), float(at[1]))) for piece, (label, at) in places.items()}


def load(place: Path) -> tuple[dict[str, MapObject], dict[str, MapObject]]:
    """Objects and vanished ones of the map, by id; none before the first is saved."""
    from edgemap.runtime.step.map_file import load_annotated_map

    if not (place / "map.json").is_file():
        return {}, {}
    objects, annotations = load_annotated_map(place)
    return {item.id: item for item in objects}, {item.id: item for item in annotations.vanished}


def nearest(item: MapObject, truth: Truth) -> str | None:
    """The piece that an object is: the only one of its class within 0.5 m."""
    near = [piece for piece, (label, at) in truth.items() if label == item.label and dist(at, item.place_m) <= NEAR_M]
    return near[0] if len(near) == 1 else None


def asked(
    piece: str,
    identity: str,
    objects: dict[str, MapObject],
    gone: dict[str, MapObject],
    truths: list[Truth],
    found: list[int],
) -> tuple[str, str]:
    """right, wrong, unknown or no time, and the answer in words. found: boots that found their place in the map."""

    def stood(boots: Iterable[int], at: tuple[float, float]) -> bool:
        places = [truths[boot].get(piece, ("", (1e9, 1e9)))[1] for boot in boots]
        return bool(places) and all(dist(place, at) <= NEAR_M for place in places)

    item = objects.get(identity) or next((one for one in objects.values() if identity in one.former_ids), None)
    if item is None:
        if identity not in gone:
            return "unknown", ""
        event = gone[identity].history[-1]
        if event.what == "missed":
            return "unknown", ""
        if event.at is None or event.from_m is None:
            return "no time", ""
        boot = boot_at(event.at, len(truths))
        text = f"{identity} is gone since boot {boot} from {event.from_m}"
        return ("wrong" if boot is None or stood((boot,), event.from_m) else "right"), text
    if ellipse_95(item.covariance_m2)[0] > NEAR_M:
        return "unknown", ""
    since = item.since
    text = f"{item.label} {piece} ({identity}) is {item.id} at {item.place_m}, since {since}, last {item.last_seen}"
    if item.last_seen is None or since is None:
        ever = any(stood((boot,), item.place_m) for boot in range(len(truths)))
        return ("no time" if ever else "wrong"), text
    first, last = (boot_at(at, len(truths)) for at in (since, item.last_seen))
    if first is None or last is None:
        return "wrong", text
    boots = [boot for boot in range(first, last + 1) if boot in (first, last, *found)]
    return ("right" if stood(boots, item.place_m) else "wrong"), text


def boot_at(at: float, count: int) -> int | None:
    """The boot that ran at a wall time; None where none did."""
    boot = int((at - START_S + 1.0) // DAY_S)
    return boot if 0 <= boot < count and at - START_S - boot * DAY_S < LATE_S else None


if __name__ == "__main__":
    tyro.cli(main, description=__doc__)
