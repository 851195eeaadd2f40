"""`edgemap fleet serve`: keeps the merged map of a place from the latest map of each robot."""

import hashlib
import json
import threading
import time
from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec

from edgemap.geometry.errors import MapError
from edgemap.geometry.objects.place import Alignments, MergedRobot, PlaceMap, RobotMap, merge_place
from edgemap.geometry.se2 import SE2
from edgemap.runtime.disk import write_atomically
from edgemap.runtime.errors import DiskError
from edgemap.runtime.fleet.network import (
    MESSAGE_BYTES,
    NAME,
    name_of,
    open_session,
    packed,
    place_key,
    robot_of,
    rounded,
    unpacked_map,
)
from edgemap.runtime.map_file import load_annotated_map, map_document, read_map, save_map
from edgemap.runtime.reading import Coordinate, decode_json

MAXIMUM_ROBOTS, MAXIMUM_OBJECTS = 100, 1000  # of a place, and of one robot's map
LARGEST_M, MAXIMUM_COUNTED = 1000.0, 1 << 30  # so that what is merged stays within what a map may hold
ROUTER_S = 10.0  # for which a router is waited for
MAXIMUM_BYTES = {"map": MESSAGE_BYTES, "pose": 1000}


class _PoseMessage(msgspec.Struct):
    x_m: Coordinate
    y_m: Coordinate
    yaw_rad: Coordinate


@dataclass(slots=True)
class Robot:
    """What is known of one robot. restarted: since its latest map, which stays while it has more than the new one.
    came_s: clock of its last map; refused: why its last message was not taken."""

    here: bool = False
    restarted: bool = False
    latest: RobotMap | None = None
    pose: SE2 | None = None
    came_s: float | None = None
    refused: str = ""


class _Inbox:
    """The newest message of each robot and kind, put in by zenoh's threads: bounded, whatever comes."""

    def __init__(self, names: Collection[str]) -> None:
        self._names, self._lock = set(names), threading.Lock()
        self._newest: dict[tuple[str, str], bytes] = {}

    def put(self, kind: str, name: str, message: bytes) -> None:
        """Keep it in place of the one before, where there is room for the robot."""
        with self._lock:
            if name in self._names or len(self._names) < MAXIMUM_ROBOTS:
                self._names.add(name)
                self._newest[kind, name] = message

    def take(self) -> dict[tuple[str, str], bytes]:
        """All that has come, by kind (`here`, `map`, `pose`) and robot."""
        with self._lock:
            taken, self._newest = self._newest, {}
            return taken


class PlaceKeeper:
    """Takes each robot's latest map, and merges when `update` is called; `folder/map.json` is the place's.

    Robots' maps are kept in `folder/robots/NAME.json`, so that a robot that is away stays in the map, through a
    restart too. A damaged or too large message is refused with the reason; the map before it stays.
    Raises PublishError, MissingExtraError, MapError for a map in the folder that is none, or DiskError.
    """

    def __init__(
        self, place: str, folder: Path, connect: str = "", listen: str = "", reference: Path | None = None
    ) -> None:
        self.place, self.folder = name_of(place, "place"), folder
        self.robots: dict[str, Robot] = {}
        self.merged = PlaceMap()
        self._reference = _robot_map(*load_annotated_map(reference)) if reference else None
        self._alignments: Alignments = {}
        self._stale = True
        try:
            (folder / "robots").mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise DiskError(f"{folder}/robots: cannot be made ({error.strerror})") from None
        for path in sorted((folder / "robots").glob("*.json"))[:MAXIMUM_ROBOTS]:
            if NAME.fullmatch(path.stem):
                self.robots[path.stem] = Robot(latest=_robot_map(*load_annotated_map(path)))
        self._inbox = _Inbox(self.robots)
        self._session: Any = open_session(connect, listen, wait_s=None if listen else ROUTER_S)
        root = place_key(place)
        self._key, self._document = f"{root}/map", packed(self.document())
        alive = self._session.liveliness()
        self._declared = [
            self._session.declare_subscriber(f"{root}/robots/*/map", self._on_message),
            self._session.declare_subscriber(f"{root}/robots/*/pose", self._on_message),
            alive.declare_subscriber(f"{root}/robots/*", self._on_alive, history=True),
            self._session.declare_queryable(self._key, self._on_question),
            alive.declare_token(f"{root}/keeper"),
        ]
        self._publisher = self._session.declare_publisher(self._key)

    def update(self) -> bool:
        """Take in what has come; merge, save and publish where that changes the map. Whether it did.

        Raises DiskError, or MapError where the merged map holds numbers that no map may hold; the file stays then.
        """
        for (kind, name), message in self._inbox.take().items():
            robot = self.robots.setdefault(name, Robot())
            try:
                self._take(kind, name, robot, message)
            except DiskError:
                raise
            except MapError as error:
                robot.refused = str(error)
        changed, self._stale = self._stale, False
        if changed:
            latest = {name: robot.latest for name, robot in self.robots.items() if robot.latest is not None}
            self.merged = merge_place(latest, self._reference, self._alignments)
            text = json.dumps(self.document(), indent=1) + "\n"
            read_map(text.encode(), f"map of {self.place}")  # robots may send any numbers; what is saved can be read
            write_atomically(self.folder / "map.json", text)
        self._document = packed(self.document())
        if changed:
            self._publisher.put(self._document)
        return changed

    def document(self) -> dict[str, Any]:
        """The place's map as `map.json` holds it, and `fleet`: what became of each robot's map."""
        robots = {name: self._robot_document(name, robot) for name, robot in sorted(self.robots.items())}
        document = map_document(list(self.merged.objects), self.merged.annotations)
        return document | {"fleet": {"place": self.place, "robots": robots}}

    def close(self) -> None:
        """Leave; the folder stays."""
        self._session.close()

    def _robot_document(self, name: str, robot: Robot) -> dict[str, Any]:
        member = self.merged.members.get(name, MergedRobot(None, reason="no map of it yet"))
        document: dict[str, Any] = {"here": robot.here, "objects": len(robot.latest.objects) if robot.latest else 0}
        document |= {"map_age_s": round(time.monotonic() - robot.came_s, 1)} if robot.came_s is not None else {}
        if member.pose_place_map is None:
            document |= {"apart": member.reason}
        else:
            document |= {
                "pairs": member.pairs,
                "shared": member.shared,
                "pose_place_map": rounded(member.pose_place_map),
            }
            if robot.pose is not None:
                document |= {"pose_place_base": rounded(member.pose_place_map @ robot.pose)}
        return document | ({"refused": robot.refused} if robot.refused else {})

    def _take(self, kind: str, name: str, robot: Robot, message: bytes) -> None:
        """Take in one message. Raises MapError where it is none of ours, DiskError where it cannot be kept."""
        source = f"{kind} of {name}"
        if kind == "here":
            robot.restarted |= bool(message) and not robot.here
            robot.here, self._stale = bool(message), self._stale or robot.here != bool(message)
            return
        if kind == "pose":
            pose = decode_json(message, _PoseMessage, source, MapError)
            robot.pose = SE2(pose.x_m, pose.y_m, pose.yaw_rad)
            return
        objects, annotations = unpacked_map(message, source)
        if len(objects) > MAXIMUM_OBJECTS:
            raise MapError(f"{source}: {len(objects)} objects, at most {MAXIMUM_OBJECTS} are merged")
        for item in objects:
            if (
                max(*abs(item.position_m), *item.covariance_m2.diagonal() ** 0.5) > LARGEST_M
                or item.count > MAXIMUM_COUNTED
            ):
                raise MapError(
                    f"{source}: {item.id} lies, or is unsure by, more than {LARGEST_M:g} m, or is seen too often"
                )
        robot.refused, robot.came_s, latest = "", time.monotonic(), _robot_map(objects, annotations)
        before = 0 if robot.latest is None else len(robot.latest.objects)
        if robot.restarted and len(objects) < before:
            robot.refused = (
                f"{len(objects)} objects since it started again: its map of {before} stays until it has as many"
            )
            return
        robot.restarted = False
        if robot.latest is None or robot.latest.key != latest.key:
            robot.latest, self._stale = latest, True
            save_map(self.folder / "robots" / f"{name}.json", objects, annotations)

    # On zenoh's threads.

    def _on_message(self, sample: Any) -> None:
        key = str(sample.key_expr)
        kind = key.rpartition("/")[2]
        if (name := robot_of(key)) and len(sample.payload) <= MAXIMUM_BYTES[kind]:
            self._inbox.put(kind, name, sample.payload.to_bytes())

    def _on_alive(self, sample: Any) -> None:
        import zenoh

        key, here = str(sample.key_expr), sample.kind == zenoh.SampleKind.PUT
        if name := robot_of(key):
            self._inbox.put("here", name, b"1" if here else b"")

    def _on_question(self, query: Any) -> None:
        query.reply(self._key, self._document)


def _robot_map(objects: list[Any], annotations: Any) -> RobotMap:
    text = json.dumps(map_document(objects, annotations), sort_keys=True)
    return RobotMap(hashlib.sha256(text.encode()).hexdigest(), tuple(objects), annotations.zones)
