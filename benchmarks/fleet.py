"""Many robots, one map: `python -m edgemap.benchmarks.fleet --data drive:DIR [--robots 8] [--frames 450]`.

One drive through a home is cut into overlapping parts, each driven by an `edgemap run --fleet` of its own that starts
in a frame of its own, all at once; a keeper merges their maps. Prints as JSON the result of each map, the F1 of the
merged map and the single ones (against the objects visible on the complete drive), the errors of the alignments, and
what a robot sends, by hour of its stream: bytes of zenoh's payloads and keys.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np

from edgemap.benchmarks.map_variants import true_objects
from edgemap.evaluation.objects import score_map
from edgemap.geometry.objects.merge import moved
from edgemap.geometry.registration.alignment import Alignment
from edgemap.geometry.se2 import SE2
from edgemap.runtime.inputs.drives import open_drive
from edgemap.runtime.inputs.drives.drive import Drive
from edgemap.runtime.outputs.fleet.keeper import PlaceKeeper
from edgemap.runtime.outputs.fleet.network import open_session
from edgemap.runtime.step.map_file import load_map

ADDRESS, PLACE = "127.0.0.1:17447", "home"


def part(drive: Drive, first: int, frames: int, folder: Path) -> None:
    """Frames of a drive as a drive of its own."""
    (folder / "images").mkdir(parents=True)
    for image in drive.images[first : first + frames]:
        (folder / "images" / image.name).symlink_to(image.resolve())
    (folder / "camera.yaml").symlink_to((drive.folder / "camera.yaml").resolve())
    lines = [line for line in (drive.folder / "poses.tum").read_text().splitlines(keepends=True) if line[0] != "#"]
    (folder / "poses.tum").write_text("".join(lines[first : first + frames]))
    if drive.wheel is not None:
        (folder / "wheel.csv").symlink_to(drive.wheel.resolve())


def drive_all(drive: Drive, firsts: list[int], frames: int, folder: Path) -> dict[str, Any]:
    """Keeper and robots at work; the place's document once all have ended, and what each has sent."""
    keeper = PlaceKeeper(PLACE, folder / "place", listen=ADDRESS)
    listener, done = open_session(connect=ADDRESS, wait_s=5.0), threading.Event()
    messages, sent = Counter[str](), Counter[str]()
    merges_s: list[float] = []

    def count(sample: Any) -> None:
        key = str(sample.key_expr)
        if "/robots/" in key:
            messages[key.rpartition("/")[2]] += 1
            sent[key.rpartition("/")[2]] += len(key) + len(sample.payload)

    def keep() -> None:
        while not done.wait(1.0):
            before_s = time.process_time()
            if keeper.update():
                merges_s.append(time.process_time() - before_s)

    subscriber = listener.declare_subscriber(f"edgemap/fleet/{PLACE}/**", count)
    keeping = threading.Thread(target=keep)
    keeping.start()
    robots = []
    for number, first in enumerate(firsts):
        part(drive, first, frames, folder / f"part{number}")
        command = [
            sys.executable,
            "-m",
            "edgemap.cli",
            "run",
            "--camera",
            f"drive:{folder}/part{number}",
            "--threads",
            "1",
        ]
        command += ["--fleet", f"{PLACE}@{ADDRESS}", "--robot", f"robot{number}", "--out", str(folder / f"run{number}")]
        robots.append(subprocess.Popen(command, stdout=subprocess.DEVNULL))
    codes = [robot.wait() for robot in robots]
    done.set()
    keeping.join()
    keeper.update()
    del subscriber
    listener.close()
    keeper.close()
    share = len(firsts) * frames / (drive.rate_hz or 10.0) / 3600.0  # robots by hours of stream
    traffic = {
        kind: {"messages_per_hour": round(messages[kind] / share), "bytes_per_hour": round(sent[kind] / share)}
        for kind in ("map", "pose")
    }
    return {
        "exit_codes": codes, "robot_sends": traffic, "merges": len(merges_s),
        "longest_merge_cpu_s": round(max(merges_s, default=0.0), 2), "fleet": keeper.document()["fleet"],
    }  # fmt: skip


def main() -> None:
    """Run it and print the figures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", required=True, metavar="drive:DIR")
    parser.add_argument("--robots", type=int, default=8)
    parser.add_argument("--frames", type=int, default=450)
    parser.add_argument("-o", "--out", type=Path, help="keep parts, runs and the place's folder here")
    chosen = parser.parse_args()
    drive = open_drive(chosen.data)
    firsts = np.linspace(0, len(drive.images) - chosen.frames, chosen.robots).round().astype(int).tolist()
    assert drive.truth is not None
    starts = [drive.truth.poses[first] for first in firsts]
    truth = true_objects(drive)
    with tempfile.TemporaryDirectory() as temporary:
        folder = chosen.out or Path(temporary)
        figures = drive_all(drive, firsts, chosen.frames, folder)
        for number, start in enumerate(starts):
            record = figures["fleet"]["robots"][f"robot{number}"]
            record["f1"] = _f1(load_map(folder / f"run{number}"), start, truth)
            if "pose_place_map" in record:
                off = (starts[0].inverse() @ start).inverse() @ SE2(*record["pose_place_map"])
                record["alignment_off"] = [round(float(np.hypot(off.x_m, off.y_m)), 3), round(off.yaw_rad, 4)]
        place = load_map(folder / "place")
        figures |= {"objects": len(place), "f1": _f1(place, starts[0], truth)}
    print(json.dumps(figures, indent=1))


def _f1(objects: list[Any], start: SE2, truth: list[Any]) -> float:
    """Of a map in the frame of a pose of the drive."""
    alignment = Alignment.exact(start)
    return round(score_map([moved(item, alignment) for item in objects], truth)["f1"] or 0.0, 3)


if __name__ == "__main__":
    main()
