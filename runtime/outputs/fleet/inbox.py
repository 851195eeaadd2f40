"""What robots have sent and the keeper has not read yet: bounded, and fair to a robot that comes late."""

import threading
from collections.abc import Iterable, Sequence
from random import Random

from edgemap.runtime.outputs.fleet.access import MAXIMUM_ROBOTS

ON_TRIAL = 10  # rooms besides: in a full place too a new robot's map is looked at


class Inbox:
    """The newest message of each robot and kind, stored by zenoh's threads; its size is bounded. Only a sender of a map
    replaces another name: one that never sent a map, else the first of `give_way`. A name whose map the keeper has not
    read yet keeps its slot, unless there are more names than slots; then all have the same chance.
    """

    def __init__(self, names: Iterable[str]) -> None:
        self._names, self._lock = dict.fromkeys(names, True), threading.Lock()  # whether it ever brought a map
        self._newest: dict[tuple[str, str], bytes] = {}
        self._yielding, self._judged = list[str](), frozenset[str]()
        self._turned_away, self._random = 0, Random()

    def put(self, kind: str, name: str, message: bytes) -> None:
        """Keep it in place of the one before, where there is room for the robot."""
        with self._lock:
            if name not in self._names and len(self._names) >= MAXIMUM_ROBOTS + ON_TRIAL:
                leaving = self._leaving() if kind == "map" else None
                if leaving is None:
                    return
                self._forget(leaving)
            self._names[name] = self._names.get(name, False) or kind == "map"
            self._newest[kind, name] = message

    def take(self) -> dict[tuple[str, str], bytes]:
        """All that has come, by kind (`here`, `map`, `pose`) and robot."""
        with self._lock:
            taken, self._newest, self._turned_away = self._newest, {}, 0
            return taken

    def put_back(self, kind: str, name: str, message: bytes) -> None:
        """Returns a message that was not processed in this turn; a newer one replaces it, and it is dropped if its
        sender lost its slot.
        """
        with self._lock:
            if name in self._names:
                self._newest.setdefault((kind, name), message)

    def settle(self, stays: Iterable[str], give_way: Sequence[str]) -> None:
        """The keeper has looked at these robots' maps. give_way: those whose room another may have, in this order."""
        with self._lock:
            self._judged, self._yielding = frozenset({*stays, *give_way}), list(give_way)

    def forget(self, name: str) -> None:
        """Frees the robot's slot."""
        with self._lock:
            self._forget(name)

    def knows(self, name: str) -> bool:
        """Whether the robot still has room here."""
        with self._lock:
            return name in self._names

    def _leaving(self) -> str | None:
        """Who leaves for a new name that brings a map; None where the new one is turned away."""
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
