"""Cost and latency of live outputs: `python -m edgemap.benchmarks.output_cost OUTPUT [--frames N] [--rate HZ]`.

OUTPUT: ros2, foxglove, rerun (into a file), mqtt or fleet (both without anybody there). The demo, frame by frame at a
rate, stamped as it is handed over; every step's result goes to the sink of that output, first without a reader, then
for ros2 and foxglove with one in a process of its own, which reads poses, tf, odometry, boxes and the map (--pictures:
those too). `share` is the sink's processor time by that of the steps, all threads included: busy machines disturb it
little. `latency_ms` is from a frame's stamp to the reader's odometry, `transport_ms` from the end of the step: wall
time, to be read with the load.
"""

from __future__ import annotations

import argparse
import json
import os
import struct
import subprocess
import sys
import tempfile
import time
from collections import deque
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from edgemap.runtime.frames.errors import PublishError
from edgemap.runtime.frames.frame import Frame
from edgemap.runtime.frames.messages import topics
from edgemap.runtime.frames.messages.stamps import ns_of, to_ns
from edgemap.runtime.outputs.messages.stream import MessageStream

SETTLE = 10  # steps at the start that are not counted
SILENT_S = 5.0  # after which a reader gives up
WANTED = (topics.POSE, topics.ODOMETRY, topics.TF, topics.BOXES, topics.OBJECTS, topics.MARKERS, topics.GRID)
Received = list[tuple[int, float]]  # stamp in ns, and when it was read, Unix s


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
        with suppress(PublishError):  # nobody is there, which is what is measured
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


def ros2_odometry(wanted: list[str]) -> Iterator[tuple[int, float]]:
    """Odometry as another ROS 2 program reads it, decoded; every other topic that is wanted is read too."""
    from edgemap.runtime.inputs.ros2.node import Reliability, shared_node
    from edgemap.runtime.inputs.ros2.types import in_namespace
    from edgemap.runtime.outputs.publishers.ros2 import GLOBAL

    node = shared_node()
    readers = {}
    for topic in wanted:
        name = topic if topic in GLOBAL else in_namespace("edgemap", topic)
        readers[topic] = node.subscription(name, topics.KINDS[topic], Reliability.RELIABLE)
    print("ready", flush=True)
    while readers[topics.ODOMETRY].wait(SILENT_S):
        for message in readers[topics.ODOMETRY].take():
            yield ns_of(message.header.stamp), time.time()
        for topic, reader in readers.items():
            if topic != topics.ODOMETRY:
                deque(reader.take(), maxlen=0)


def foxglove_odometry(wanted: list[str], url: str) -> Iterator[tuple[int, float]]:
    """Odometry as a client of Foxglove's protocol gets it."""
    from websockets.sync.client import connect

    with connect(url, subprotocols=["foxglove.sdk.v1"], max_size=None) as socket:  # type: ignore[list-item]
        socket.recv(timeout=SILENT_S)
        channels = {item["topic"]: item["id"] for item in json.loads(socket.recv(timeout=SILENT_S))["channels"]}
        wishes = [{"id": number, "channelId": channels[topic]} for number, topic in enumerate(wanted)]
        socket.send(json.dumps({"op": "subscribe", "subscriptions": wishes}))
        socket.ping().wait(SILENT_S)
        print("ready", flush=True)
        while True:
            try:
                message = socket.recv(timeout=SILENT_S)
            except TimeoutError:
                return
            if isinstance(message, bytes) and message[0] == 1:
                number, stamp_ns = struct.unpack("<IQ", message[1:13])
                if wanted[number] == topics.ODOMETRY:
                    yield stamp_ns, time.time()


def open_sink(output: str, floor: Any, pictures: bool, folder: Path) -> tuple[Any, str]:
    """The sink, and the address of its server."""
    stream = MessageStream(floor.intrinsics, floor.mount)
    if output == "ros2":
        from edgemap.runtime.inputs.ros2.node import shared_node
        from edgemap.runtime.outputs.publishers.ros2 import Ros2Options, Ros2Sink

        return Ros2Sink(shared_node(), floor, Ros2Options(pictures=pictures), ros_time=True), ""
    if output == "foxglove":
        from edgemap.runtime.outputs.publishers.foxglove import FoxgloveServer

        server = FoxgloveServer("127.0.0.1", 0, stream)
        return server, server.url
    if output == "rerun":
        from edgemap.runtime.outputs.publishers.rerun import RerunStream

        return RerunStream(folder / "drive.rrd", stream), ""
    if output == "mqtt":
        from edgemap.runtime.outputs.publishers.mqtt import MqttPublisher

        return MqttPublisher("127.0.0.1", 1, "robot"), ""
    from edgemap.runtime.outputs.fleet.sink import FleetSink

    return FleetSink("home", "robot", "127.0.0.1:1"), ""


def percentiles(values_s: list[float]) -> dict[str, float]:
    """Percentiles in milliseconds."""
    p50, p95, p99 = np.percentile(1e3 * np.array(values_s[SETTLE:]), [50, 95, 99]).round(1).tolist()
    return {"p50": p50, "p95": p95, "p99": p99}


def main() -> None:
    """Measure on the demo and print one JSON document."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n\n")[1])
    parser.add_argument("output", choices=("ros2", "foxglove", "rerun", "mqtt", "fleet"))
    parser.add_argument("--bundle", default="edgemap-nano")
    parser.add_argument("--frames", type=int, default=300)
    parser.add_argument("--rate", type=float, default=10.0)
    parser.add_argument("--pictures", action="store_true")
    parser.add_argument("--listen", help=argparse.SUPPRESS)
    given = parser.parse_args()
    os.environ.setdefault("ROS_DOMAIN_ID", str(1 + os.getpid() % 100))
    if given.listen is not None:
        wanted = [*WANTED, *[topics.PICTURES, topics.INFO] * given.pictures]
        reading = ros2_odometry(wanted) if given.output == "ros2" else foxglove_odometry(wanted, given.listen)
        print(json.dumps([row for row, _ in zip(reading, range(given.frames), strict=False)]))
        return
    with tempfile.TemporaryDirectory() as folder:
        figures = measure(given, Path(folder))
    print(json.dumps(figures | {"load_average": os.getloadavg()[0]}, indent=1))


def measure(given: argparse.Namespace, folder: Path) -> dict[str, Any]:
    """Measures one output."""
    from edgemap.geometry.camera.floor import FloorCamera
    from edgemap.runtime.inputs.open import open_camera
    from edgemap.runtime.motion.odometry import open_odometry
    from edgemap.runtime.network.bundle import load_bundle
    from edgemap.runtime.network.store import bundle_folder
    from edgemap.runtime.step.config import Config
    from edgemap.runtime.step.mapper import new_mapper
    from edgemap.runtime.step.pipeline import Pipeline
    from edgemap.runtime.step.slam import SemanticSlam

    bundle = load_bundle(bundle_folder(given.bundle), pace="camera")
    figures: dict[str, Any] = {name: getattr(given, name) for name in ("output", "rate", "frames", "pictures")}
    with open_camera("demo") as camera:
        assert camera.intrinsics is not None
        assert camera.mount is not None
        floor = FloorCamera(camera.intrinsics, camera.mount)
        images = [frame.image for _ in range(200) if (frame := camera.read())]
        for name in ("without_reader", "with_reader")[: 1 + (given.output in ("ros2", "foxglove"))]:
            odometry = open_odometry("hybrid", bundle, camera, floor, wheels=False)
            slam = SemanticSlam(Pipeline(bundle, floor, odometry), new_mapper(Config()))
            sink, url = open_sink(given.output, floor, given.pictures, folder)
            reader = None
            if name == "with_reader":
                command = [sys.executable, "-m", "edgemap.benchmarks.output_cost", *sys.argv[1:], "--listen", url]
                reader = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
                assert reader.stdout is not None
                reader.stdout.readline()
                time.sleep(2.0)  # they find each other
            figures[name], done_s = drive(slam, sink, images, given.frames, given.rate)
            if reader is not None and reader.stdout is not None:
                received: Received = json.loads(reader.stdout.read())
                figures["latency_ms"] = percentiles([at_s - stamp_ns / 1e9 for stamp_ns, at_s in received])
                figures["transport_ms"] = percentiles([at_s - done_s[stamp_ns] for stamp_ns, at_s in received])
                figures["received"] = len(received)
            sink.close()
    return figures


if __name__ == "__main__":
    main()
