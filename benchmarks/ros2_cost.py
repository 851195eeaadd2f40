"""Cost and latency of `run --ros2`: `python -m edgemap.benchmarks.ros2_cost [--frames N] [--rate HZ] [--pictures]`.

The demo, frame by frame at a rate, stamped as it is handed over; every step's result goes to the sink of `--ros2`,
first without a reader, then with one in a process of its own, which reads poses, tf, odometry, boxes and the map (and
pictures). `share` is the sink's processor time by that of the steps, all threads included: busy machines disturb it
little. `latency_ms` is from a frame's stamp to the reader's decoded odometry, `transport_ms` from the end of the step:
wall time, to be read with the load.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import time
from collections import deque
from typing import Any

import numpy as np

from edgemap.runtime.frame import Frame
from edgemap.runtime.messages import topics
from edgemap.runtime.messages.stamps import ns_of, to_ns

SETTLE = 10  # steps at the start that are not counted


def drive(
    slam: Any, sink: Any, images: list[Any], frames: int, rate_hz: float
) -> tuple[dict[str, float], dict[int, float]]:
    """Figures of step and sink, and when each step was done (Unix s) by its stamp in ns."""
    steps_s, sinks_s, walls_s = [], [], []
    done_s: dict[int, float] = {}
    start_s = time.time() + 0.1
    for index in range(frames):
        time.sleep(max(0.0, start_s + index / rate_hz - time.time()))
        stamp_s, before_s = time.time(), time.process_time()
        result = slam.step(Frame(index, stamp_s, images[index % len(images)]))
        objects = slam.objects()
        between_s = time.process_time()
        done_s[to_ns(stamp_s)] = time.time()
        sink.write(result, objects)
        steps_s.append(between_s - before_s)
        sinks_s.append(time.process_time() - between_s)
        walls_s.append(done_s[to_ns(stamp_s)] - stamp_s)
    step_ms, sink_ms = (1e3 * float(np.mean(values[SETTLE:])) for values in (steps_s, sinks_s))
    figures = {
        "share": round(sink_ms / step_ms, 4),
        "step_cpu_ms": round(step_ms, 2),
        "sink_cpu_ms": round(sink_ms, 3),
        "step_ms": round(1e3 * float(np.median(walls_s[SETTLE:])), 1),
    }
    return figures, done_s


def listen(wanted: list[str], frames: int) -> None:
    """Read the topics as another program would, and print when odometry was decoded, as [stamp in ns, Unix s]."""
    from edgemap.runtime.ros2.names import in_namespace
    from edgemap.runtime.ros2.node import Reliability, shared_node
    from edgemap.runtime.ros2.sink import GLOBAL

    node = shared_node()
    readers = {}
    for topic in wanted:
        name = topic if topic in GLOBAL else in_namespace("edgemap", topic)
        readers[topic] = node.subscription(name, topics.KINDS[topic], Reliability.RELIABLE)
    print("ready", flush=True)
    received: list[tuple[int, float]] = []
    last_s = time.monotonic()
    while len(received) < frames and time.monotonic() - last_s < 5.0:
        if not readers[topics.ODOMETRY].wait(0.5):
            continue
        for message in readers[topics.ODOMETRY].take():
            received.append((ns_of(message.header.stamp), time.time()))
            last_s = time.monotonic()
        for topic, reader in readers.items():
            if topic != topics.ODOMETRY:
                deque(reader.take(), maxlen=0)
    print(json.dumps(received))


def percentiles(values_s: list[float]) -> dict[str, float]:
    """In milliseconds."""
    p50, p95, p99 = np.percentile(1e3 * np.array(values_s[SETTLE:]), [50, 95, 99]).round(1).tolist()
    return {"p50": p50, "p95": p95, "p99": p99}


def main() -> None:
    """Measure on the demo and print one JSON document."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n\n")[1])
    parser.add_argument("--bundle", default="edgemap-nano")
    parser.add_argument("--frames", type=int, default=300)
    parser.add_argument("--rate", type=float, default=10.0)
    parser.add_argument("--pictures", action="store_true")
    parser.add_argument("--listen", action="store_true", help=argparse.SUPPRESS)
    given = parser.parse_args()
    wanted = [topics.POSE, topics.ODOMETRY, topics.TF, topics.BOXES, topics.OBJECTS, topics.MARKERS]
    wanted += [topics.PICTURES, topics.INFO] * given.pictures
    os.environ.setdefault("ROS_DOMAIN_ID", str(1 + os.getpid() % 100))
    if given.listen:
        listen(wanted, given.frames)
        return
    from edgemap.geometry.camera.floor import FloorCamera
    from edgemap.runtime.bundle import load_bundle
    from edgemap.runtime.cameras import open_camera
    from edgemap.runtime.config import Config
    from edgemap.runtime.mapper import new_mapper
    from edgemap.runtime.odometry import open_odometry
    from edgemap.runtime.pipeline import Pipeline
    from edgemap.runtime.ros2.node import shared_node
    from edgemap.runtime.ros2.sink import Ros2Options, Ros2Sink
    from edgemap.runtime.slam import SemanticSlam
    from edgemap.runtime.store import bundle_folder

    bundle = load_bundle(bundle_folder(given.bundle), pace="camera")
    with open_camera("demo") as camera:
        assert camera.intrinsics is not None
        assert camera.mount is not None
        floor = FloorCamera(camera.intrinsics, camera.mount)
        images = [frame.image for _ in range(200) if (frame := camera.read())]
        figures: dict[str, Any] = {"rate_hz": given.rate, "frames": given.frames, "pictures": given.pictures}
        for name in ("without_reader", "with_reader"):
            odometry = open_odometry("hybrid", bundle, camera, floor, wheels=False)
            slam = SemanticSlam(Pipeline(bundle, floor, odometry), new_mapper(Config()))
            sink = Ros2Sink(shared_node(), floor, Ros2Options(pictures=given.pictures), ros_time=True)
            reader = None
            if name == "with_reader":
                command = [sys.executable, "-m", "edgemap.benchmarks.ros2_cost", *sys.argv[1:], "--listen"]
                reader = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
                assert reader.stdout is not None
                reader.stdout.readline()
                time.sleep(2.0)  # they find each other
            figures[name], done_s = drive(slam, sink, images, given.frames, given.rate)
            if reader is not None and reader.stdout is not None:
                received = json.loads(reader.stdout.read())
                figures["latency_ms"] = percentiles([at_s - stamp_ns / 1e9 for stamp_ns, at_s in received])
                figures["transport_ms"] = percentiles([at_s - done_s[stamp_ns] for stamp_ns, at_s in received])
                figures["received"] = len(received)
            sink.close()
    figures["load_average"] = os.getloadavg()[0]
    print(json.dumps(figures, indent=1))


if __name__ == "__main__":
    main()
