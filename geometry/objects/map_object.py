"""The map of the floor: objects with a place, a size and an identity; written to disk so that nothing is ever lost."""

from __future__ import annotations

import json
import math
import os
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.errors import MapError
from edgemap.geometry.observations.sighting import PlacedSighting

Array = NDArray[np.float64]

FORMAT = "edgemap.map/1"
CHI2_95 = 5.991  # squared Mahalanobis distance that holds 95 % in the plane


@dataclass(frozen=True, slots=True, eq=False)
class MapObject:
    """One object on the floor. position_m: (2,) x, y in the map frame; covariance_m2: (2, 2) of it.

    width_m, height_m: mean apparent size. count: sightings. confidence: 0..1. Stamps in seconds. seen_from_m: (x, y)
    places that it was seen from, half a metre apart; a map may not know them.
    """

    id: str
    label: str
    position_m: Array
    covariance_m2: Array
    width_m: float
    height_m: float
    count: int
    confidence: float
    first_seen_s: float
    last_seen_s: float
    seen_from_m: tuple[tuple[float, float], ...] = ()


class ObjectMap(Protocol):
    """A clustering of sightings into objects, fed frame by frame.

    merged: ids that are no more, to the id of the object that they became part of.
    """

    merged: dict[str, str]

    def update(self, sightings: list[PlacedSighting]) -> list[str]:
        """Take in all sightings of ONE frame; the id of each one's object, in the same order."""
        ...

    def objects(self) -> list[MapObject]:
        """The objects as they stand now, ordered by id."""
        ...


class SightingSums:
    """Sums over an object's sightings from which its size, confidence and times follow; two sums can be joined."""

    __slots__ = ("count", "first_seen_s", "height_m", "last_seen_s", "miss", "sure", "width_m")

    def __init__(self) -> None:
        self.count, self.sure, self.width_m, self.height_m, self.miss = 0, 0.0, 0.0, 0.0, 0.0
        self.first_seen_s, self.last_seen_s = math.inf, -math.inf

    @classmethod
    def of_saved(cls, item: MapObject) -> SightingSums:
        """The sums of an object that an earlier map holds."""
        sums = cls()
        sums.count, sums.sure = item.count, float(item.count)
        sums.width_m, sums.height_m = item.width_m * item.count, item.height_m * item.count
        sums.miss = math.log1p(-min(item.confidence, 1.0 - 1e-9))
        sums.first_seen_s, sums.last_seen_s = item.first_seen_s, item.last_seen_s
        return sums

    def add(self, placed: PlacedSighting) -> None:
        """Count one more sighting."""
        sighting = placed.sighting
        self.count += 1
        self.sure += sighting.sure
        self.width_m += sighting.width_m
        self.height_m += sighting.height_m
        self.miss += math.log1p(-min(sighting.score, 0.999)) / 4.0  # four looks in a row tell about one thing
        self.first_seen_s = min(self.first_seen_s, sighting.stamp_s)
        self.last_seen_s = max(self.last_seen_s, sighting.stamp_s)

    def join(self, other: SightingSums) -> None:
        """Take in another object's sums."""
        self.count += other.count
        self.sure += other.sure
        self.width_m += other.width_m
        self.height_m += other.height_m
        self.miss += other.miss
        self.first_seen_s = min(self.first_seen_s, other.first_seen_s)
        self.last_seen_s = max(self.last_seen_s, other.last_seen_s)

    @property
    def confidence(self) -> float:
        """1 - product of (1 - score) over every fourth sighting."""
        return -math.expm1(self.miss)

    def as_object(self, identity: str, label: str, position_m: Array, covariance_m2: Array) -> MapObject:
        """The object that these sums describe."""
        return MapObject(
            identity, label, position_m, covariance_m2, self.width_m / self.count, self.height_m / self.count,
            self.count, self.confidence, self.first_seen_s, self.last_seen_s,
        )  # fmt: skip


def id_order(identity: str) -> tuple[str, int]:
    """Sort key of ids such as `chair-12`: by label, then by number; a foreign id counts as a label with number 0."""
    label, _, number = identity.rpartition("-")
    return (label, int(number)) if number.isdecimal() else (identity, 0)


def map_document(objects: list[MapObject]) -> dict:
    """The map as the JSON document that `map.json` holds. `seen_from_m`, where known: id to places it was seen from."""
    seen = [item for item in objects if item.seen_from_m]
    views = {item.id: [[round(x_m, 3), round(y_m, 3)] for x_m, y_m in item.seen_from_m] for item in seen}
    document = {
        "format": FORMAT,
        "frame": "map",
        "objects": [
            {
                "id": item.id,
                "label": item.label,
                "x_m": round(float(item.position_m[0]), 6),
                "y_m": round(float(item.position_m[1]), 6),
                "covariance_m2": [[round(float(v), 9) for v in row] for row in item.covariance_m2],
                "width_m": round(item.width_m, 4),
                "height_m": round(item.height_m, 4),
                "count": item.count,
                "confidence": round(item.confidence, 6),
                "first_seen_s": round(item.first_seen_s, 6),
                "last_seen_s": round(item.last_seen_s, 6),
            }
            for item in objects
        ],
    }
    return document | ({"seen_from_m": views} if views else {})


def write_atomically(path: Path, text: str | bytes) -> None:
    """Replace a file's content at once: readers and a power cut see the old text or the new one, never a part.

    Raises MapError where the folder cannot be written.
    """
    try:
        handle, temporary = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
        try:
            with os.fdopen(handle, "wb") as stream:
                stream.write(text.encode() if isinstance(text, str) else text)
                stream.flush()
                os.fsync(stream.fileno())
            Path(temporary).chmod(0o644)
            Path(temporary).replace(path)
        except BaseException:
            Path(temporary).unlink(missing_ok=True)
            raise
    except OSError as error:
        raise MapError(f"{path}: cannot be written ({error.strerror})") from None


def map_text(objects: list[MapObject]) -> str:
    """The map as the text of `map.json`."""
    return json.dumps(map_document(objects), indent=1) + "\n"


def save_map(path: Path, objects: list[MapObject]) -> None:
    """Write `map.json` atomically."""
    write_atomically(path, map_text(objects))


def load_map(path: Path) -> list[MapObject]:
    """Read a map.json, or the one of a run folder. Raises MapError in one line for anything else."""
    if path.is_dir():
        path = path / "map.json"
    try:
        document = json.loads(path.read_text())
    except OSError as error:
        raise MapError(f"{path}: cannot be read ({error.strerror})") from None
    except ValueError as error:
        raise MapError(f"{path}: not a JSON map ({error})") from None
    if not isinstance(document, dict) or document.get("format") != FORMAT:
        raise MapError(f"{path}: not an {FORMAT} document")
    try:
        views = document.get("seen_from_m", {})
        return [_object_of(record, views.get(record["id"], ())) for record in document["objects"]]
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise MapError(f"{path}: damaged map ({type(error).__name__}: {error})") from None


def _object_of(record: dict, views: Sequence[Sequence[float]]) -> MapObject:
    covariance = np.array(record["covariance_m2"], dtype=np.float64)
    position = np.array([record["x_m"], record["y_m"]], dtype=np.float64)
    if covariance.shape != (2, 2) or not (np.isfinite(covariance).all() and np.isfinite(position).all()):
        raise ValueError(f"object {record['id']} needs a finite position and 2x2 covariance")
    return MapObject(
        str(record["id"]), str(record["label"]), position, covariance, float(record["width_m"]),
        float(record["height_m"]), int(record["count"]), float(record["confidence"]),
        float(record["first_seen_s"]), float(record["last_seen_s"]), tuple((float(x), float(y)) for x, y in views),
    )  # fmt: skip
