"""Bounded buffer of robot messages that the keeper has not read yet. A robot that connects late gets a fair chance."""

import threading
from collections.abc import Iterable, Sequence
from random import Random

from edgemap.bridges.fleet.access import MAXIMUM_ROBOTS

ON_TRIAL = 10  # additional slots, so that the map of a new robot is evaluated even if the place is full


class Inbox:
    """The newest message of each robot and kind, stored by zenoh's threads; its size is bounded. Only a sender of a map
    replaces another name: one that never sent a map, else the first of `give_way`. A name whose map the keeper has not
    read yet keeps its slot, unless there are more names than slots; then all have the same chance.
    """

    def __init__(self, names: Iterable[str]) -> None:
        self._names, self._lock = dict.fromkeys(names, True), threading.Lock()  # whether it ever sent a map
        self._newest: dict[tuple[str, str], bytes] = {}
        self._yielding, self._judged = list[str](), frozenset[str]()
        self._turned_away, self._random = 0, Random()

    def put(self, kind: str, name: str, message: bytes) -> None:
        """Stores a message and replaces the previous one, if the robot has or gets a slot."""
        with self._lock:
            if name not in self._names and len(self._names) >= MAXIMUM_ROBOTS + ON_TRIAL:
                leaving = self._leaving() if kind == "map" else None
                if leaving is None:
                    return
                self._forget(leaving)
            self._names[name] = self._names.get(name, False) or kind == "map"
            self._newest[kind, name] = message

    def take(self) -> dict[tuple[str, str], bytes]:
        """Removes and returns all stored messages, by kind (`here`, `map`, `pose`) and robot."""
        with self._lock:
            taken, self._newest, self._turned_away = self._newest, {}, 0
            return taken

    def put_back(self, kind: str, name: str, message: bytes) -> None:
        """Stores a message again that was not processed in this turn. It is dropped if a newer one has arrived, or if
        its sender no longer has a slot.
        """
        with self._lock:
            if name in self._names:
                self._newest.setdefault((kind, name), message)

    def settle(self, stays: Iterable[str], give_way: Sequence[str]) -> None:
        """Records that the keeper has evaluated the maps of these robots. stays: robots in the merged map. give_way:
        robots whose slots a new robot may take, in this order.
        """
        with self._lock:
            self._judged, self._yielding = frozenset({*stays, *give_way}), list(give_way)

    def forget(self, name: str) -> None:
        """Frees the robot's slot."""
        with self._lock:
            self._forget(name)

    def knows(self, name: str) -> bool:
        """Whether the robot still has a slot."""
        with self._lock:
            return name in self._names

    def _leaving(self) -> str | None:
        """The robot that loses its slot to a new robot with a map; None if the new robot is rejected."""
        if empty := next((name for name, mapped in self._names.items() if not mapped), None):
            return empty
        while self._yielding:
            if (name := self._yielding.pop(0)) in self._names:
                return name
        new = [name for name in self._names if name not in self._judged]
        self._turned_away += 1
        drawn = self._random.randrange(len(new) + self._turned_away)  # reservoir sampling
        return new[drawn] if drawn < len(new) else None

    def _forget(self, name: str) -> None:
        self._names.pop(name, None)
        for key in [key for key in self._newest if key[1] == name]:
            del self._newest[key]
