"""`--sink fleet:PLACE`: sends a robot's map and pose to the keeper of its place."""

import json
from collections.abc import Callable
from typing import Any

from edgemap.bridges.fleet.network import ROOT, checked_name, open_session, place_and_address
from edgemap.geometry.grid.occupancy_grid import OccupancyGrid
from edgemap.geometry.map_object import MapObject
from edgemap.geometry.objects.annotations import NO_ANNOTATIONS, Annotations
from edgemap.runtime.frames.errors import BridgeError, UsageError
from edgemap.runtime.frames.limits import EVERY_S
from edgemap.runtime.frames.reading import read_bytes
from edgemap.runtime.frames.timing import StreamTimer
from edgemap.runtime.outputs.sinks.kinds import RunInfo
from edgemap.runtime.outputs.verdict.verdict import Verdict
from edgemap.runtime.step.grid_file import grid_bytes
from edgemap.runtime.step.map_file import map_document, map_path, pose_record
from edgemap.runtime.step.sinks import Sink
from edgemap.runtime.step.slam import StepResult

MAP_EVERY_S = 5.0  # of stream


class FleetSink(Sink):
    """Sends the pose every second, the map every five where it has changed and it has objects, to a new keeper and at
    the end. `write` raises BridgeError without a keeper. Raises MissingExtraError, BridgeError for an invalid name.
    """

    name = "fleet"

    def __init__(
        self, place: str, robot: str, address: str, verdict: Callable[[], Verdict] = lambda: Verdict("care")
    ) -> None:
        self._missing = f"nobody keeps the map of {checked_name(place, 'place')} at {address} (edgemap fleet serve)"
        root, key = f"{ROOT}/{place}", f"{ROOT}/{place}/robots/{checked_name(robot, 'robot')}"
        self._session: Any = open_session(connect=address)
        self._message, self._kept, self._verdict = "", False, verdict
        self._latest: tuple[list[MapObject], Annotations, OccupancyGrid | None] = [], NO_ANNOTATIONS, None
        self._grid_bytes = b""
        self._pose_timer, self._map_timer = StreamTimer(EVERY_S), StreamTimer(MAP_EVERY_S)
        self._map, self._pose = (self._session.declare_publisher(f"{key}/{what}") for what in ("map", "pose"))
        alive = self._session.liveliness()
        self._token = alive.declare_token(key)
        self._keeper = alive.declare_subscriber(f"{root}/keeper", self._on_keeper, history=True)

    def write(self, result: StepResult, objects: list[MapObject]) -> None:
        """Sends what is due."""
        stamp_s, self._latest = result.frame.stamp_s, (objects, result.annotations, result.grid)
        if self._map_timer.due(stamp_s):
            self._send_map()
        if self._pose_timer.due(stamp_s):
            self._pose.put(json.dumps(pose_record(result.pose_map_base)))
        if not self._kept:
            raise BridgeError(self._missing)

    last = write

    def close(self) -> None:
        """Sends the last map and leaves; may be called twice."""
        if not self._session.is_closed():
            self._send_map()
            self._session.close()

    def _send_map(self) -> None:
        objects, annotations, grid = self._latest
        message = json.dumps(map_document(objects, self._verdict().on(annotations), grid))
        if message != self._message and (self._message or objects):
            self._message, self._grid_bytes = message, b"" if grid is None else grid_bytes(grid)
            self._map.put(message, attachment=self._grid_bytes)

    def _on_keeper(self, sample: Any) -> None:  # on a thread of zenoh's
        self._kept = str(sample.kind).endswith("PUT")
        if self._kept and self._message:
            self._map.put(self._message, attachment=self._grid_bytes)


def open(address: str, run: RunInfo) -> FleetSink:
    """The sink of `--sink fleet:PLACE[@HOST[:PORT]]`. Raises UsageError, or as the sink does."""
    if run.saved is not None and b'"pose_place_map"' in read_bytes(map_path(run.saved), UsageError):
        raise UsageError(f"--map {run.saved} is merged from robots of a fleet: what they saw would count twice")
    place, where = place_and_address(address, "--sink fleet:")
    return FleetSink(place, run.robot, where, run.verdict)
