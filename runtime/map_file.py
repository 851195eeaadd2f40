"""`map.json`: the map on disk, written atomically and read with every value checked."""

from __future__ import annotations

import json
import os
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from edgemap.geometry.errors import MapError
from edgemap.geometry.objects.map_object import MapObject

FORMAT = "edgemap.map/1"


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
