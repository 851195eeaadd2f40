"""Maps by name: their folder on this machine, and the resolution of MAP on the command line."""

import os
import re
from dataclasses import dataclass
from pathlib import Path

import platformdirs

from edgemap.geometry.errors import MapError
from edgemap.runtime.frames.reading import one_line, user_path

AUTO = "auto"  # the named map of the place where the robot is
NAME = re.compile(r"[^\W_][\w .-]{0,62}")  # 63 letters of any script fit a file name of 255 bytes


@dataclass(frozen=True, slots=True)
class MapPlace:
    """What a MAP means. path: a map.json or a folder that holds one. lives: whether a run saves back into it; a run
    folder and a map.json are only read."""

    path: Path
    lives: bool

    @property
    def exists(self) -> bool:
        """Whether there is a map yet."""
        return self.path.is_file() or (self.path / "map.json").is_file()


def maps_folder() -> Path:
    """`$EDGEMAP_DATA/maps`, or in the user's data folder for edgemap."""
    return Path(os.environ.get("EDGEMAP_DATA") or platformdirs.user_data_path("edgemap")) / "maps"


def find_map(text: str | Path) -> MapPlace:
    """The map that a text names: a map.json or a run folder is only read; a name or another folder is saved back to.

    A name begins with a letter or digit of any script, has no slash, and no map of that name is in the current folder.
    Raises MapError for an empty text.
    """
    if not str(text):
        raise MapError("the map's name is empty")  # an unset variable is not the current folder
    path = user_path(str(text))
    is_file = path.is_file() or path.suffix == ".json"
    if is_file or (path / "run.json").is_file() or (path / "robots").is_dir():  # the last is a fleet's place
        return MapPlace(path, lives=False)
    if NAME.fullmatch(str(text)) and not (path / "map.json").is_file():
        return MapPlace(maps_folder() / str(text), lives=True)
    return MapPlace(path, lives=True)


def saved_map(text: str | Path) -> Path:
    """The map.json or folder of a map to read. Raises MapError for a name that neither a folder nor a map has."""
    place = find_map(text)
    if not place.exists and place.path.parent == maps_folder():
        raise MapError(f"{one_line(text)}: no run folder or map.json here, and no map of that name in {maps_folder()}")
    return place.path
