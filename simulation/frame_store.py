"""Finished pictures of a recording on disk, so that a recording that was stopped goes on where it was."""

from __future__ import annotations

import json
import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from edgemap.simulation.errors import SimulationError
from edgemap.simulation.studio import Shot

# Says what the folder holds; written first, and with `complete` set as the very last thing.
RECORD_NAME = "simulation.json"
_PARTS = ".parts"
_MOST_DEPTH_MM = 65535


class FrameStore:
    """The folder of one recording. settings: all that decides about its content.

    Raises SimulationError where the folder holds something else, which is left alone.
    """

    def __init__(self, folder: Path, settings: dict[str, Any], pictures: str | None, depth: bool) -> None:
        self.folder, self._settings, self._depth = folder, settings, depth
        self.parts = folder / _PARTS
        self.pictures = folder / pictures if pictures else self.parts
        record = folder / RECORD_NAME
        self.complete = False
        if record.is_file():
            known = json.loads(record.read_text())
            self.complete = bool(known.pop("complete", False))
            if known != settings:
                differing = [name for name in settings if known.get(name) != settings[name]]
                raise SimulationError(
                    f"{folder} holds another recording (it differs in {', '.join(differing) or 'its format'}): "
                    "choose another folder, or remove it"
                )
        elif folder.is_dir() and any(folder.iterdir()):
            raise SimulationError(f"{folder} is not empty and holds no recording to go on with: choose another folder")
        if self.complete:
            return
        for path in (self.parts, self.pictures, *([folder / "depth"] if depth else [])):
            path.mkdir(parents=True, exist_ok=True)
        write_text(record, json.dumps(settings, indent=1))

    def missing(self, frames: int) -> list[int]:
        """Indices of pictures that are still to be made."""
        return [index for index in range(frames) if not self._part(index).is_file()]

    def save(self, shot: Shot) -> None:
        """Keep a picture; its truth comes last, and only with it the picture counts as made."""
        name = f"{shot.index:06d}"
        write_bytes(self.pictures / (name + shot.suffix), shot.picture)
        if self._depth:
            millimetres = np.clip(shot.depth_m * 1000.0 + 0.5, 0, _MOST_DEPTH_MM).astype(np.uint16)
            write_bytes(self.folder / "depth" / f"{name}.png", cv2.imencode(".png", millimetres)[1].tobytes())
        write_text(self._part(shot.index), json.dumps(shot.boxes))

    def boxes(self, frames: int) -> list[list[dict[str, Any]]]:
        """The truth of all pictures, as boxes.json has it."""
        return [json.loads(self._part(index).read_text()) for index in range(frames)]

    def picture_paths(self) -> Sequence[Path]:
        """The pictures in order."""
        return sorted(path for path in self.pictures.iterdir() if path.suffix in (".png", ".jpg"))

    def finish(self) -> None:
        """Everything is written: forget the parts."""
        write_text(self.folder / RECORD_NAME, json.dumps({**self._settings, "complete": True}, indent=1))
        shutil.rmtree(self.parts)

    def _part(self, index: int) -> Path:
        return self.parts / f"{index:06d}.json"


def write_text(path: Path, text: str) -> None:
    """Write a file whole or not at all."""
    write_bytes(path, text.encode())


def write_bytes(path: Path, data: bytes) -> None:
    """Write a file whole or not at all. Raises SimulationError where that cannot be done."""
    unfinished = path.with_name(f".{path.name}.unfinished")
    try:
        unfinished.write_bytes(data)
        unfinished.replace(path)
    except OSError as error:
        raise SimulationError(f"{path}: cannot be written ({error.strerror})") from None
