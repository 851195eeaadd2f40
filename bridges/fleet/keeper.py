"""The keeper of a place: merges the latest map of each robot, saves the merged map and publishes it."""

import json
import threading
import uuid
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from edgemap.bridges.fleet.network import NAME, ROOT, checked_name, open_session
from edgemap.geometry.errors import MapError
from edgemap.geometry.grid.occupancy_grid import OccupancyGrid
from edgemap.geometry.objects.annotations import MapIdentity
from edgemap.geometry.objects.merge import AnnotatedMap, MergedMaps, merge_all
from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.disk import make_folder
from edgemap.runtime.frames.reading import decode_json
from edgemap.runtime.step.grid_file import grid_bytes, load_grid, read_grid, save_grid
from edgemap.runtime.step.map_file import (
    load_annotated_map,
    map_document,
    pose_record,
    read_map,
    replace_map,
    save_map,
    saved_text,
)
from edgemap.runtime.step.map_records import PoseRecord

MAXIMUM_ROBOTS, MAXIMUM_OBJECTS = 100, 1000  # of a place, and of one robot's map


@dataclass(slots=True)
class _Robot:
    """One robot of the place."""

    here: bool = False
    latest: AnnotatedMap | None = None
    grid: OccupancyGrid | None = None
    pose: SE2 | None = None
    refused: str = ""


class PlaceKeeper:
    """Keeps the merged map in `folder/map.json`, the latest map of each robot in `folder/robots/NAME.json`. reference:
    an older map, whose frame counts. Raises BridgeError, MissingExtraError, DiskError, MapError for a damaged file.
    """

    def __init__(
        self, place: str, folder: Path, connect: str = "", listen: str = "", reference: Path | None = None
    ) -> None:
        self.place, self.folder = checked_name(place, "place"), folder
        self.merged, self._stale = MergedMaps(), True
        self._reference = {} if reference is None else {"": load_annotated_map(reference)}
        self._grid = None if reference is None else load_grid(reference)
        self.robots: dict[str, _Robot] = {}
        make_folder(folder / "robots")
        for path in sorted((folder / "robots").glob("*.json"))[:MAXIMUM_ROBOTS]:
            self.robots[path.stem] = _Robot(latest=load_annotated_map(path), grid=load_grid(path))
        saved = folder / "map.json"
        identity = load_annotated_map(saved)[1].identity if saved.is_file() else None
        self.identity = identity.next() if identity else MapIdentity(str(uuid.uuid4()))
        self._inbox: dict[tuple[str, str], Any] = {}  # newest sample by kind and robot
        self._names, self._lock = set(self.robots), threading.Lock()
        root = f"{ROOT}/{place}"
        self._map, self._grid_bytes = self._map_of(self.merged), b""
        self._answer = json.dumps(self._map | self._fleet(self.merged)), self._grid_bytes
        self._session: Any = open_session(connect, listen, None if listen else 10.0)
        alive = self._session.liveliness()
        self._declared = [
            self._session.declare_subscriber(f"{root}/robots/*/map", partial(self._receive, "map")),
            self._session.declare_subscriber(f"{root}/robots/*/pose", partial(self._receive, "pose")),
            alive.declare_subscriber(f"{root}/robots/*", partial(self._receive, "here"), history=True),
            self._session.declare_queryable(f"{root}/map", self._reply),
            alive.declare_token(f"{root}/keeper"),
        ]
        self._publisher = self._session.declare_publisher(f"{root}/map")

    def update(self) -> dict[str, Any]:
        """Reads the messages; where a map has changed, merges, saves and publishes. Refuses messages that are no maps.
        Returns the state of each robot. Raises DiskError, or MapError if the merged map would be unreadable: then the
        saved one stays."""
        with self._lock:
            inbox, self._inbox = self._inbox, {}
        for (kind, name), sample in inbox.items():
            robot = self.robots.setdefault(name, _Robot())
            try:
                self._take(kind, name, robot, sample)
            except MapError as error:
                robot.refused = str(error)
        maps = {name: robot.latest for name, robot in sorted(self.robots.items()) if robot.latest is not None}
        changed = self._stale and bool(maps)
        if changed:
            grids = {name: robot.grid for name, robot in self.robots.items()} | {"": self._grid}
            merged = merge_all(self._reference | maps, "" if self._reference else None, grids)
            document = self._map_of(merged)
            text = saved_text(document | self._fleet(merged))
            read_map(text.encode(), f"map of {self.place}")
            if merged.grid is not None:
                save_grid(self.folder / "grid.npz", merged.grid)
            replace_map(self.folder / "map.json", text)
            self.merged, self._map, self._stale = merged, document, False
            self._grid_bytes = b"" if merged.grid is None else grid_bytes(merged.grid)
        state = self._fleet(self.merged)
        self._answer = json.dumps(self._map | state), self._grid_bytes
        if changed:
            self._publisher.put(self._answer[0], attachment=self._answer[1])
        return state["fleet"]["robots"]

    def close(self) -> None:
        """Leaves the network. The folder stays."""
        self._session.close()

    def _reply(self, query: Any) -> None:  # on a thread of zenoh's
        document, grid = self._answer
        query.reply(f"{ROOT}/{self.place}/map", document, attachment=grid)

    def _map_of(self, merged: MergedMaps) -> dict[str, Any]:
        own, annotations = self.identity, merged.annotations
        if (judged := annotations.identity) is not None:
            own = replace(own, level=judged.level, reasons=judged.reasons)
        return map_document(merged.objects, replace(annotations, identity=own), merged.grid)

    def _fleet(self, merged: MergedMaps) -> dict[str, Any]:
        robots: dict[str, dict[str, Any]] = {}
        for name, robot in sorted(self.robots.items()):
            state = robots[name] = {"here": robot.here, "objects": len(robot.latest[0]) if robot.latest else 0}
            if (alignment := merged.alignments.get(name)) is None:
                state["apart"] = merged.refused.get(name, "no map of it yet")
            else:
                poses = {"pose_place_map": SE2()} | ({"pose_place_base": robot.pose} if robot.pose else {})
                state |= {"pairs": len(alignment.pairs), "shared": alignment.shared}
                state |= {what: list(pose_record(alignment.pose_a_b @ pose).values()) for what, pose in poses.items()}
            state |= {"refused": robot.refused} if robot.refused else {}
            state |= {"map_id": _map_id(robot.latest)} if robot.latest else {}
        return {"fleet": {"place": self.place, "robots": robots}}

    def _take(self, kind: str, name: str, robot: _Robot, sample: Any) -> None:
        if kind == "here":
            robot.here = str(sample.kind).endswith("PUT")
            return
        message = sample.payload.to_bytes()
        if kind == "pose":
            robot.pose = decode_json(message, PoseRecord, f"pose of {name}", MapError).pose
            return
        objects, annotations = read_map(message, f"map of {name}", MAXIMUM_OBJECTS)
        before = len(robot.latest[0]) if robot.latest else 0
        if len(objects) < before and _map_id(robot.latest) != _map_id((objects, annotations)):
            raise MapError(f"{len(objects)} objects of a new map: its map of {before} stays until it has as many")
        grid_file = b"" if sample.attachment is None else sample.attachment.to_bytes()
        grid = read_grid(grid_file, f"grid of {name}") if grid_file else None
        robot.refused = ""
        if robot.latest is None or map_document(objects, annotations, grid) != map_document(
            list(robot.latest[0]), robot.latest[1], robot.grid
        ):
            save_map(self.folder / "robots" / f"{name}.json", objects, annotations, grid)
            robot.latest, robot.grid, self._stale = (objects, annotations), grid, True

    def _receive(self, kind: str, sample: Any) -> None:  # on a thread of zenoh's
        name = str(sample.key_expr).partition("/robots/")[2].partition("/")[0]
        with self._lock:
            if NAME.fullmatch(name) and (name in self._names or len(self._names) < MAXIMUM_ROBOTS):
                self._names.add(name)
                self._inbox[kind, name] = sample


def _map_id(latest: AnnotatedMap | None) -> str | None:
    """The id of a robot's map; None where it has none."""
    identity = latest[1].identity if latest else None
    return identity and identity.map_id
