"""`--fleet`: sends a robot's map and pose to the keeper of its place."""

import json
import threading
from typing import Any

from edgemap.bridges.fleet.network import name_of, open_session, packed, place_key, rounded
from edgemap.geometry.map_object import MapObject
from edgemap.geometry.objects.edits import NO_ANNOTATIONS, Annotations
from edgemap.runtime.frames.errors import PublishError
from edgemap.runtime.frames.timing import StreamTimer
from edgemap.runtime.step.map_file import map_document
from edgemap.runtime.step.sinks import Sink
from edgemap.runtime.step.slam import StepResult

POSE_EVERY_S, MAP_EVERY_S, UNCHANGED_EVERY_S = 1.0, 5.0, 60.0  # of stream
CONNECT_LIMIT_S = 2.0  # for which the run's start waits


class FleetSink(Sink):
    """Sends the pose every second and the map every five, where it has changed; at the end the map once more.

    A run's map is first sent when it has an object: until then the previous run's counts. An unchanged map is sent
    every minute, and whenever a keeper appears. zenoh's threads send and reconnect; messages that a slow network cannot
    accept are dropped. `write` raises PublishError while there is no keeper. Raises MissingExtraError, or PublishError
    for an invalid name.
    """

    name = "fleet"

    def __init__(self, place: str, robot: str, address: str) -> None:
        self._place, self._address = name_of(place, "place"), address
        root = place_key(place)
        key = f"{root}/robots/{name_of(robot, 'robot')}"
        self._session: Any = open_session(connect=address)
        self._message, self._sending = b"", threading.Lock()
        self._objects, self._annotations = list[MapObject](), NO_ANNOTATIONS
        intervals_s = POSE_EVERY_S, MAP_EVERY_S, UNCHANGED_EVERY_S
        self._pose_timer, self._map_timer, self._sent_timer = map(StreamTimer, intervals_s)
        self._kept = threading.Event()
        self._map, self._pose = (self._session.declare_publisher(f"{key}/{what}") for what in ("map", "pose"))
        alive = self._session.liveliness()
        self._declared = [
            alive.declare_token(key),
            alive.declare_subscriber(f"{root}/keeper", self._on_keeper, history=True),
        ]
        self._kept.wait(CONNECT_LIMIT_S)

    def write(self, result: StepResult, objects: list[MapObject]) -> None:
        """Sends what is due."""
        stamp_s, annotations = result.frame.stamp_s, result.annotations
        if self._map_timer.due(stamp_s) and self._send_map(objects, annotations, self._sent_timer.is_due(stamp_s)):
            self._sent_timer.done(stamp_s)
        self._objects, self._annotations = objects, annotations
        if self._pose_timer.due(stamp_s):
            pose = zip(("x_m", "y_m", "yaw_rad"), rounded(result.pose_map_base), strict=True)
            self._pose.put(json.dumps(dict(pose)))
        if not self._kept.is_set():
            raise PublishError(f"nobody keeps the map of {self._place} at {self._address} (edgemap fleet serve)")

    def close(self) -> None:
        """Send the last map and leave; may be called twice."""
        if not self._session.is_closed():
            self._send_map(self._objects, self._annotations)
            self._session.close()

    def _send_map(self, objects: list[MapObject], annotations: Annotations, again: bool = False) -> bool:
        if not self._message and not objects:
            return False
        message = packed(map_document(objects, annotations))
        with self._sending:
            if message == self._message and not again:
                return False
            self._message = message
            self._map.put(message)
        return True

    def _on_keeper(self, sample: Any) -> None:  # on a thread of zenoh's
        import zenoh

        if sample.kind == zenoh.SampleKind.DELETE:
            self._kept.clear()
            return
        with self._sending:
            if self._message:
                self._map.put(self._message)
        self._kept.set()
