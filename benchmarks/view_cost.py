"""Cost of the live page per step: `python -m edgemap.benchmarks.view_cost [--bundle B] [--rounds N]`.

Blocks of steps in turn within one run: without the page, with the page without viewers, and with one viewer that reads
every update. The cost is a ratio of the mean step, `write` included; the median over rounds. The viewer is a process of
its own on this machine, so that what it takes from the cores is in the cost as well.
"""

from __future__ import annotations

import argparse
import itertools
import json
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from edgemap.benchmarks.bench import read_frames
from edgemap.runtime.frames.frame import Frame
from edgemap.runtime.step.mapper import Mapper
from edgemap.runtime.step.pipeline import Pipeline
from edgemap.runtime.step.slam import SemanticSlam
from edgemap.view.page import LivePage

DECODED = 64  # pictures, which go round forwards and backwards
STEPS = 20  # in a block: short, so that what else the machine does meets all alike
SETTLE = 4  # steps after a change that are not counted


def view_cost(slam: SemanticSlam, frames: Iterator[Frame], rounds: int, rate_hz: float | None = None) -> dict[str, Any]:
    """Ratios of the mean step with the page to that without, idle and viewed; and what was sent.

    page_cpu_ms: processor time of the page's thread for each update sent, which other processes do not disturb.
    rate_hz: frames per second at most; None for as fast as it goes.
    """
    from edgemap.view.server import PageServer

    page = LivePage({"marks": {}}, Path(tempfile.gettempdir()))
    server = PageServer(page, "127.0.0.1", 0)
    command = [sys.executable, "-m", "edgemap.benchmarks.view_cost", "--look-at", str(server.port)]
    looker = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    assert looker.stdin is not None
    assert looker.stdout is not None
    looker.stdout.readline()  # it is connected
    order = np.random.default_rng(0)
    laps = {name: [] for name in ("without", "idle", "viewed")}
    try:
        for turn in range(rounds + 1):
            for name in order.permutation(list(laps)).tolist():
                looker.stdin.write("on\n" if name == "viewed" else "off\n")
                looker.stdin.flush()
                block_ms = _block(slam, frames, None if name == "without" else page, rate_hz)
                if turn:  # the first warms up
                    laps[name].append(block_ms)
        looker.stdin.close()
        received = json.loads(looker.stdout.read())
        page_cpu_s = server.cpu_s()
    finally:
        looker.kill()
        looker.wait()
        server.close()
    without = np.array(laps["without"])
    return {
        "idle_ratio": round(float(np.median(laps["idle"] / without)), 4),
        "viewed_ratio": round(float(np.median(laps["viewed"] / without)), 4),
        "step_ms": {name: round(float(np.median(values)), 3) for name, values in laps.items()},
        "rate_hz": rate_hz,
        "rounds": rounds,
        "updates_received": received["updates"],
        "page_cpu_ms": round(1e3 * page_cpu_s / max(1, received["updates"]), 2),
        "kilobytes_each": round(received["bytes"] / max(1, received["updates"]) / 1e3, 1),
    }


def _block(slam: SemanticSlam, frames: Iterator[Frame], page: LivePage | None, rate_hz: float | None) -> float:
    """Mean milliseconds of a step and its `write`, waiting for the next frame's time not counted."""
    stages_ms, next_s = [], time.perf_counter()
    for step in range(SETTLE + STEPS):
        if rate_hz is not None:
            time.sleep(max(0.0, next_s - time.perf_counter()))
            next_s = max(next_s + 1.0 / rate_hz, time.perf_counter())
        began_s = time.perf_counter()
        result = slam.step(next(frames))
        objects = slam.objects()
        if page is not None:
            page.write(result, objects)
        if step >= SETTLE:
            stages_ms.append(1e3 * (time.perf_counter() - began_s))
    return float(np.mean(stages_ms))


def look(port: int) -> None:
    """The viewer: takes every update and asks for the next, on and off by standard input; prints its counts."""
    from websockets.exceptions import ConnectionClosed
    from websockets.sync.client import connect

    with connect(f"ws://127.0.0.1:{port}/api/stream", max_size=None, proxy=None) as socket:
        got = {"updates": 0, "bytes": 0}

        def receive() -> None:
            try:
                for message in socket:
                    if isinstance(message, bytes):
                        got["updates"] += 1
                        got["bytes"] += len(message)
                        socket.send('{"do":"shown"}')
            except ConnectionClosed:
                pass

        threading.Thread(target=receive, daemon=True).start()
        print("connected", flush=True)
        for line in sys.stdin:
            socket.send(json.dumps({"do": "stream", "on": line.strip() == "on"}))
        print(json.dumps(got), flush=True)


def main() -> None:
    """Measure on the demo and print one JSON document."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n\n")[1])
    parser.add_argument("--bundle", default="yolox-nano")
    parser.add_argument("--rounds", type=int, default=60)
    parser.add_argument(
        "--rate", type=float, default=None, help="frames per second at most; as fast as it goes without"
    )
    parser.add_argument("--look-at", type=int, default=None, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.look_at is not None:
        look(given.look_at)
        return
    from edgemap.geometry.camera.floor import FloorCamera
    from edgemap.runtime.inputs.open import open_camera
    from edgemap.runtime.motion.odometry.planar import PlanarOdometry
    from edgemap.runtime.network.bundle import load_bundle
    from edgemap.runtime.network.store import bundle_folder

    bundle = load_bundle(bundle_folder(given.bundle))
    with open_camera("demo") as camera:
        assert camera.intrinsics is not None
        assert camera.mount is not None
        floor = FloorCamera(camera.intrinsics, camera.mount)
        images = [frame.image for frame in read_frames(camera, DECODED)]
    images += images[-2:0:-1]
    frames = (Frame(index, index / 10.0, images[index % len(images)]) for index in itertools.count())
    slam = SemanticSlam(Pipeline(bundle, floor, PlanarOdometry(floor)), Mapper())
    print(json.dumps(view_cost(slam, frames, given.rounds, given.rate) | {"bundle": bundle.manifest.name}, indent=1))


if __name__ == "__main__":
    main()
