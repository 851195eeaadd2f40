"""Finished parts of a rendering on disk, so that an interrupted one can be resumed."""

import json
import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from edgemap.runtime.frames.disk import make_folder, write_atomically
from edgemap.runtime.frames.frame import png
from edgemap.simulation.errors import SimulationError
from edgemap.simulation.studio import Shot

# What the folder holds; written first, and last of all again with `complete` set.
RECORD_NAME = "simulation.json"
_PARTS = ".parts"
_MOST_DEPTH_MM = 65535


class PartStore:
    """A folder that is rendered part by part. settings: all that decides about its content; folders: made in it.

    Raises SimulationError where the folder holds something else, which is left alone.
    """

    def __init__(self, folder: Path, settings: dict[str, Any], folders: Sequence[str] = ()) -> None:
        self.folder, self._settings = folder, settings
        self.parts = folder / _PARTS
        self.complete = False
        record = folder / RECORD_NAME
        if record.is_file():
            known = json.loads(record.read_text())
            self.complete = bool(known.pop("complete", False))
            if known != settings:
                differing = [name for name in settings if known.get(name) != settings[name]]
                raise SimulationError(
                    f"{folder} holds another rendering (it differs in {', '.join(differing) or 'its format'}): "
                    "choose another folder, or remove it"
                )
        elif folder.is_dir() and any(folder.iterdir()):
            raise SimulationError(f"{folder} is not empty and holds no rendering to go on with: choose another folder")
        if self.complete:
            return
        for path in (self.parts, *(folder / name for name in folders)):
            make_folder(path)
        write_atomically(record, json.dumps(settings, indent=1))

    @staticmethod
    def part_of(folder: Path, number: int) -> Path:
        """The file that marks a part as done and holds its truth."""
        return folder / _PARTS / f"{number:06d}.json"

    def missing(self, numbers: Sequence[int]) -> list[int]:
        """The parts that are missing."""
        return [number for number in numbers if not self.part_of(self.folder, number).is_file()]

    def read(self, number: int) -> Any:
        """Contents of a part's file."""
        return json.loads(self.part_of(self.folder, number).read_text())

    def finish(self) -> None:
        """Everything is written: forget the parts."""
        write_atomically(self.folder / RECORD_NAME, json.dumps({**self._settings, "complete": True}, indent=1))
        shutil.rmtree(self.parts)


class FrameStore(PartStore):
    """A drive, picture by picture. pictures: the folder they go to, None for ones that become a video."""

    def __init__(self, folder: Path, settings: dict[str, Any], pictures: str | None, depth: bool) -> None:
        super().__init__(folder, settings, [name for name in (pictures, "depth" if depth else None) if name])
        self._depth = depth
        self._pictures = folder / pictures if pictures else self.parts

    def save(self, shot: Shot) -> None:
        """Saves a picture; its truth is written last and marks the picture as complete."""
        name = f"{shot.index:06d}"
        write_atomically(self._pictures / (name + shot.suffix), shot.picture)
        if self._depth:
            millimetres = np.clip(shot.depth_m * 1000.0 + 0.5, 0, _MOST_DEPTH_MM).astype(np.uint16)
            write_atomically(self.folder / "depth" / f"{name}.png", png(millimetres))
        write_atomically(self.part_of(self.folder, shot.index), json.dumps(shot.boxes))

    def picture_paths(self) -> Sequence[Path]:
        """The pictures in order."""
        return sorted(path for path in self._pictures.iterdir() if path.suffix in (".png", ".jpg"))
