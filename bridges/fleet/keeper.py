"""`edgemap fleet serve`: maintains the merged map of a place from the latest map of each robot."""

import hashlib
import json
import time
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import msgspec

from edgemap.bridges.fleet.access import MAXIMUM_ROBOTS, NAME
from edgemap.bridges.fleet.inbox import Inbox
from edgemap.bridges.fleet.network import (
    MESSAGE_BYTES,
    name_of,
    open_session,
    packed,
    place_key,
    robot_of,
    rounded,
    unpacked_map,
)
from edgemap.geometry.errors import MapError
from edgemap.geometry.map_object import MapObject
from edgemap.geometry.objects.edits import Annotations
from edgemap.geometry.objects.place import (
    Alignments,
    MergeBudget,
    MergedRobot,
    MergeStopped,
    PlaceMap,
    RobotMap,
    merge_place,
)
from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.disk import make_folder, write_atomically
from edgemap.runtime.frames.errors import DiskError
from edgemap.runtime.frames.reading import Coordinate, decode_json, one_line
from edgemap.runtime.step.map_file import load_annotated_map, map_document, read_map, save_map

LARGEST_M, MAXIMUM_COUNTED = 1000.0, 1 << 20  # so that the merged map stays within the limits of a map: a day at 10 Hz
MAXIMUM_VIEWS, MAXIMUM_LABELS = 100, 10  # of an object of one robot; the merged one may have 10,000 and 1,000
LONGEST_LABEL = 80  # letters
ROUTER_S = 10.0  # maximum wait for a router
MAXIMUM_BYTES = {"map": MESSAGE_BYTES, "pose": 1000}
TURN_OBJECTS = 3000  # read before a merge; robots with the smallest recent cost come first
PASSES = 3  # of one update. A robot whose cost makes others wait joins last
EXPIRES_S = {"apart": 86_400.0, "merged": 30 * 86_400.0}  # absence after which the map of a robot is deleted
SILENT_S = 120.0  # absent after this silence; a robot sends its pose every second and its map every minute
STRANGERS = 20  # maximum number of reports about messages with an invalid key


class _PoseMessage(msgspec.Struct):
    x_m: Coordinate
    y_m: Coordinate
    yaw_rad: Coordinate


@dataclass(slots=True)
class Robot:
    """The state of one robot. restarted: it restarted after its latest map. This map is kept while it has more objects
    than the new one. came_s: clock at its last map. heard_s: clock at its last message. refused: why its last message
    was rejected. culprit: key of the map of this robot that made the merged map invalid.
    """

    here: bool = False
    restarted: bool = False
    latest: RobotMap | None = None
    pose: SE2 | None = None
    came_s: float | None = None
    heard_s: float = 0.0
    refused: str = ""
    culprit: str = ""


class PlaceKeeper:
    """Receives the latest map of each robot and merges them in `update`. `folder/map.json` is the map of the place.

    Robot maps are stored in `folder/robots/NAME.json`. An absent robot therefore stays in the map for a month, also
    after a restart (for a day if its map cannot be aligned). A message that is damaged or too large is rejected with
    the reason, and the previous map stays. Reading messages in turn and a `MergeBudget` bound the cost of each robot. A
    robot whose map makes the merged map invalid is excluded by name. inbox: messages that `update` reads next. budget:
    of the merges. began_s: clock at the start, before which nobody is absent. passwords: of robots, by name. Each robot
    can then send under its own name only; without passwords, names are not verified. Raises PublishError,
    MissingExtraError, MapError for an invalid map in the folder, or DiskError.
    """

    def __init__(
        self, place: str, folder: Path, connect: str = "", listen: str = "", reference: Path | None = None,
        passwords: Mapping[str, str] | None = None,
    ) -> None:  # fmt: skip
        self.place, self.folder = name_of(place, "place"), folder
        self.robots: dict[str, Robot] = {}
        self.merged = PlaceMap()
        self._reference = _robot_map(*load_annotated_map(reference)) if reference else None
        self._alignments: Alignments = {}
        self._stale = True
        self.budget, self._arrivals, self.began_s = MergeBudget(), 0, time.monotonic()
        self._cost: Counter[str] = Counter()  # recent bytes of each robot, halved at each update
        self._good: frozenset[str] = frozenset()  # robots in the last valid merged map
        self.strangers: list[str] = []  # reports about messages with an invalid key
        make_folder(folder / "robots")
        kept = {path.stem: path for path in sorted((folder / "robots").glob("*.json")) if NAME.fullmatch(path.stem)}
        for name in [name for name in kept if not passwords or name in passwords][:MAXIMUM_ROBOTS]:
            self.robots[name] = Robot(latest=_robot_map(*load_annotated_map(kept[name])))
        self.inbox = Inbox(self.robots)
        self._session: Any = open_session(connect, listen, None if listen else ROUTER_S, passwords, place)
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

    def update(self, stopped: Callable[[], bool] = lambda: False) -> bool:
        """Processes received messages. If they change the map, merges, saves and publishes it. Returns whether it
        changed. stopped: polled during the merge; when it returns true, the map stays unchanged until the next update.
        Raises DiskError, or MapError if no merged map is valid; the file then stays unchanged.
        """
        self._take_in(stopped)
        if stopped():
            return False
        self._expire()
        changed, self._stale = self._stale, False
        if changed:
            try:
                self.merged, text = self._merge(stopped)
            except MergeStopped:
                self._stale = True
                return False
            write_atomically(self.folder / "map.json", text)
        self._settle()
        self._document = packed(self.document())
        if changed:
            self._publisher.put(self._document)
        return changed

    def _take_in(self, stopped: Callable[[], bool]) -> None:
        """Reads as many messages as one turn allows. Robots with the smallest recent cost come first."""
        room, now_s = TURN_OBJECTS, time.monotonic()
        taken = self.inbox.take()
        order = sorted(taken, key=lambda key: (key[0] == "map", self._cost[key[1]], len(taken[key])))
        for kind, name in order:
            message = taken[kind, name]
            if room <= 0 or stopped():
                self.inbox.put_back(kind, name, message)
                continue
            robot = self.robots.setdefault(name, Robot())
            robot.heard_s = now_s
            self._cost[name] += len(message)
            try:
                room -= self._take(kind, name, robot, message)
            except DiskError:
                raise
            except MapError as error:
                robot.refused = str(error)
        self._cost = Counter({name: cost // 2 for name, cost in self._cost.items() if cost > 1})

    def _expire(self) -> None:
        """Removes robots that are absent for too long, and robots whose slot another robot has taken."""
        now_s = time.monotonic()
        for name, robot in list(self.robots.items()):
            away_s = now_s - max(robot.heard_s, self.began_s)
            if self.inbox.knows(name):
                if robot.here or away_s <= EXPIRES_S["merged" if self._in_place(name) else "apart"]:
                    continue
                self.inbox.forget(name)
            del self.robots[name]
            if robot.latest is not None:
                (self.folder / "robots" / f"{name}.json").unlink(missing_ok=True)
                self._stale = True

    def _in_place(self, name: str) -> bool:
        member = self.merged.members.get(name)
        return member is not None and member.pose_place_map is not None

    def _settle(self) -> None:
        """Determines the order in which robots lose their slots to a new robot with a map.

        First, robots without a valid map; second, robots whose map cannot be aligned; the earliest come first in both.
        Third, the robots in the place beyond `MAXIMUM_ROBOTS`; the latest come first. In each group, silent robots
        come first. A robot whose map has not been merged yet is in neither list.
        """
        now_s, came = time.monotonic(), {name: number for number, name in enumerate(self.robots)}
        present = {name: now_s - max(robot.heard_s, self.began_s) < SILENT_S for name, robot in self.robots.items()}
        judged = [name for name, robot in self.robots.items() if name in self.merged.members or robot.refused]
        stays = sorted(filter(self._in_place, judged), key=lambda name: (present[name], -came[name]))
        apart = [name for name in judged if not self._in_place(name) and name not in self.budget.waiting]
        apart.sort(key=lambda name: (self.robots[name].latest is not None, present[name], came[name]))
        self.inbox.settle(stays, apart + stays[: max(0, len(stays) - MAXIMUM_ROBOTS)])

    def _merge(self, stopped: Callable[[], bool]) -> tuple[PlaceMap, str]:
        """The merged map and its text. Robots that make it invalid are left out, each with the reason."""
        latest = {
            name: robot.latest
            for name, robot in self.robots.items()
            if robot.latest is not None and robot.latest.key != robot.culprit
        }
        try:
            return self._merged(latest, stopped)
        except MergeStopped:
            raise
        except MapError as error:
            reason = error
        good: dict[str, RobotMap] = {}
        done: tuple[PlaceMap, str] | None = None
        order = sorted(latest, key=lambda name: (name not in self._good, self.budget.arrived.get(name, 0), name))
        for name in order:  # robots of the last valid map first, then by arrival
            try:
                done = self._merged(good | {name: latest[name]}, stopped)
            except MergeStopped:
                raise
            except MapError as error:
                self.robots[name].culprit = latest[name].key
                self.robots[name].refused = f"left out, with it the merged map is none: {error}"
            else:
                good[name] = latest[name]
        if done is None:
            raise reason
        return done

    def _merged(self, latest: dict[str, RobotMap], stopped: Callable[[], bool]) -> tuple[PlaceMap, str]:
        """Merges maps. Raises MapError if the merged map is not a valid map, or MergeStopped."""
        self.budget.stopped = stopped
        for _ in range(PASSES):  # from the second pass on, an expensive robot joins last and others do not wait
            merged = merge_place(latest, self._reference, self._alignments, self.budget)
            if not self.budget.waiting:
                break
        text = json.dumps(self._document_of(merged), indent=1) + "\n"
        read_map(text.encode(), f"map of {self.place}")  # robots may send any numbers; a saved map must be readable
        self._stale, self._good = self.budget.unfinished, frozenset(latest)
        return merged, text

    def document(self) -> dict[str, Any]:
        """The map of the place in the format of `map.json`, with `fleet`: the state of each robot's map."""
        return self._document_of(self.merged)

    def _document_of(self, merged: PlaceMap) -> dict[str, Any]:
        robots = {name: self._robot_document(name, robot, merged) for name, robot in sorted(self.robots.items())}
        document = map_document(list(merged.objects), merged.annotations)
        return document | {"fleet": {"place": self.place, "robots": robots}}

    def close(self) -> None:
        """Closes the network session. The folder and its files are kept."""
        self._session.close()

    def _robot_document(self, name: str, robot: Robot, merged: PlaceMap) -> dict[str, Any]:
        member = merged.members.get(name, MergedRobot(None, reason="no map of it yet"))
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

    def _take(self, kind: str, name: str, robot: Robot, message: bytes) -> int:
        """Processes one message. Returns its number of objects. Raises MapError if it is invalid, DiskError if it
        cannot be saved.
        """
        source = f"{kind} of {name}"
        if kind == "here":
            robot.restarted |= bool(message) and not robot.here
            robot.here, self._stale = bool(message), self._stale or robot.here != bool(message)
            return 0
        if kind == "pose":
            pose = decode_json(message, _PoseMessage, source, MapError)
            robot.pose = SE2(pose.x_m, pose.y_m, pose.yaw_rad)
            return 0
        objects, annotations = received_map(message, source)
        robot.refused, robot.came_s, latest = "", time.monotonic(), _robot_map(objects, annotations)
        before = 0 if robot.latest is None else len(robot.latest.objects)
        if robot.restarted and len(objects) < before:
            robot.refused = (
                f"{len(objects)} objects since it started again: its map of {before} stays until it has as many"
            )
            return len(objects)
        robot.restarted = False
        if robot.latest is None or robot.latest.key != latest.key:
            robot.latest, self._stale = latest, True
            self.budget.arrived[name] = self._arrivals = self._arrivals + 1
            save_map(self.folder / "robots" / f"{name}.json", objects, annotations)
        return len(objects)

    # Called on threads of zenoh.

    def _on_message(self, sample: Any) -> None:
        key = str(sample.key_expr)
        kind = key.rpartition("/")[2]
        if (name := robot_of(key)) and len(sample.payload) <= MAXIMUM_BYTES.get(kind, -1):
            self.inbox.put(kind, name, sample.payload.to_bytes())
        elif len(self.strangers) < STRANGERS:
            size = f"{len(sample.payload):,} bytes"
            self.strangers.append(f"a message of {size} with the key {one_line(key, 80)} is no robot's: ignored")

    def _on_alive(self, sample: Any) -> None:
        import zenoh

        key, here = str(sample.key_expr), sample.kind == zenoh.SampleKind.PUT
        if name := robot_of(key):
            self.inbox.put("here", name, b"1" if here else b"")

    def _on_question(self, query: Any) -> None:
        query.reply(self._key, self._document)


def received_map(message: bytes, source: str) -> tuple[list[MapObject], Annotations]:
    """Objects and annotations of a robot's message, with at most `MAXIMUM_VIEWS` views and `MAXIMUM_LABELS` labels
    each. Raises MapError where the message is no map, or an object exceeds the limits of a merged map.
    """
    objects, annotations = unpacked_map(message, source)
    for item in objects:
        if (
            max(*abs(item.position_m), *item.covariance_m2.diagonal() ** 0.5) > LARGEST_M
            or item.count > MAXIMUM_COUNTED
            or max(len(item.label), len(item.id)) > LONGEST_LABEL
        ):
            raise MapError(
                f"{source}: {item.id[:LONGEST_LABEL]} lies, or is unsure by, more than {LARGEST_M:g} m, is seen "
                "too often, or has too long a name"
            )
    bounded = [
        replace(
            item,
            seen_from_m=_some(item.seen_from_m),
            labels=dict(sorted(item.labels.items(), key=lambda pair: -pair[1])[:MAXIMUM_LABELS]),
        )
        if len(item.labels) > MAXIMUM_LABELS or len(item.seen_from_m) > MAXIMUM_VIEWS
        else item
        for item in objects
    ]
    return bounded, annotations


def _robot_map(objects: list[Any], annotations: Any) -> RobotMap:
    text = json.dumps(map_document(objects, annotations), sort_keys=True)
    return RobotMap(hashlib.sha256(text.encode()).hexdigest(), tuple(objects), annotations.zones)


def _some(views: tuple[tuple[float, float], ...]) -> tuple[tuple[float, float], ...]:
    """Selects at most `MAXIMUM_VIEWS` positions evenly."""
    return views if len(views) <= MAXIMUM_VIEWS else views[:: -(-len(views) // MAXIMUM_VIEWS)]
