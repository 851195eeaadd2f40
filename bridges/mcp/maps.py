"""Where the server's answers come from: a saved map, or a run through its HTTP API."""

import json
import os
import urllib.error
import urllib.request
from pathlib import Path
from typing import Any
from urllib.parse import quote, urlsplit

import numpy as np

from edgemap.geometry.errors import MapError
from edgemap.geometry.grid.occupancy_grid import FREE, OCCUPIED, STEPS, GridRule, OccupancyGrid
from edgemap.geometry.map_object import MapObject
from edgemap.geometry.objects.annotations import Annotations
from edgemap.geometry.objects.approach import approach
from edgemap.runtime.frames.disk import lock_folder
from edgemap.runtime.frames.limits import FILE_BYTES, SILENCE_S
from edgemap.runtime.frames.reading import decode_json, one_line, read_bytes
from edgemap.runtime.step.grid_file import load_grid
from edgemap.runtime.step.map_file import (
    goal_record,
    load_annotated_map,
    map_path,
    read_map,
    replace_map,
    saved_text,
)
from edgemap.runtime.step.map_store import saved_map
from edgemap.runtime.step.wall_clock import host_clock, utc_text

BOUND = round(GridRule().highest * STEPS)


class SavedMap:
    """A map.json, a run folder or a named map; read again for every question, so it may be that of a run that goes on.
    Raises MapError where there is none, and so do all methods, in one line."""

    def __init__(self, text: str) -> None:
        self.path = map_path(saved_map(text))
        self.read()

    def read(self) -> tuple[list[MapObject], Annotations]:
        """The map on disk."""
        return load_annotated_map(self.path)

    def grid(self) -> OccupancyGrid | None:
        """The saved one."""
        return load_grid(self.path)

    def approach(self, item: MapObject, objects: list[MapObject]) -> dict[str, Any]:
        """A free pose that faces an object, by the saved grid."""
        return goal_record(approach(item, objects, self.grid()))

    def mark(self, identity: str, edit: dict[str, Any]) -> None:
        """Sets `name` and `confirmed` of an object in the file, unless a run uses it."""
        lock = lock_folder(self.path.parent, "a run uses this map: give the address of its page, http://…")
        try:
            document = decode_json(read_bytes(self.path, MapError), dict[str, Any], self.path, MapError)
            record = next(one for one in document["objects"] if one["id"] == identity)
            what = {"name": "named", "confirmed": "confirmed"}
            at = utc_text(host_clock().utc_s)
            history = [{"at": at, "what": what[key], "by": "person"} for key in edit]
            record |= edit | {"history": [*record.get("history", []), *history]}
            replace_map(self.path, saved_text(document))
        finally:
            os.close(lock)

    def picture(self, identity: str) -> bytes:
        """None is saved with a map."""
        raise MapError(f"a saved map has no picture of {identity}: ask a run, http://…")


class RunningMap:
    """A run with `--view`, at the address of its page, asked as a `SavedMap` is. Raises MapError where none answers."""

    def __init__(self, address: str) -> None:
        parts = urlsplit(address)
        self._root, self._query = f"{parts.scheme}://{parts.netloc}/api", f"?{parts.query}" if parts.query else ""
        self.read()

    def read(self) -> tuple[list[MapObject], Annotations]:
        """The map after the newest step."""
        return read_map(self._ask("GET", "map"), self._root)

    def grid(self) -> OccupancyGrid | None:
        """The floor after the newest step."""
        return floor_grid(json.loads(self._ask("GET", "floor")))

    def approach(self, item: MapObject, objects: list[MapObject]) -> dict[str, Any]:  # noqa: ARG002
        """From where the robot is now."""
        return json.loads(self._ask("GET", f"objects/{quote(item.id, safe='')}/approach"))

    def mark(self, identity: str, edit: dict[str, Any]) -> None:
        """An edit of the run."""
        self._ask("PATCH", f"objects/{quote(identity, safe='')}", edit)

    def picture(self, identity: str) -> bytes:
        """The best picture that the run has."""
        return self._ask("GET", f"objects/{quote(identity, safe='')}/picture")

    def _ask(self, method: str, what: str, body: dict[str, Any] | None = None) -> bytes:
        data = None if body is None else json.dumps(body).encode()
        request = urllib.request.Request(
            f"{self._root}/{what}{self._query}", data, {"Content-Type": "application/json"}, method=method
        )
        try:
            with urllib.request.urlopen(request, timeout=SILENCE_S) as answer:
                return answer.read(FILE_BYTES)
        except urllib.error.HTTPError as error:
            raise MapError(f"{self._root}/{what}: {one_line(error.read(500).decode(errors='replace'))}") from None
        except (OSError, ValueError) as error:
            raise MapError(f"{self._root}: no run answers ({one_line(getattr(error, 'reason', error))})") from None


MapSource = SavedMap | RunningMap


def floor_grid(floor: dict[str, Any]) -> OccupancyGrid | None:
    """The grid of an answer of `GET /api/floor`: its cells, each as free or occupied as a bound of log-odds."""
    if not floor["rows"]:
        return None
    values, counts = np.reshape(floor["runs"], (-1, 2)).T
    cells = np.repeat(values, counts).reshape(floor["rows"], floor["columns"])
    odds = np.select([cells == FREE, cells == OCCUPIED], [-BOUND, BOUND]).astype(np.int8)
    return OccupancyGrid(odds, floor["x_m"], floor["y_m"], floor["cell_m"])


def open_source(text: str) -> MapSource:
    """The map that a text means: an address of a run's page, else a saved map. Raises MapError."""
    return RunningMap(text) if text.startswith(("http://", "https://")) else SavedMap(str(Path(text)))
