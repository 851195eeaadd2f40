"""Finished parts of a rendering on disk, so that an interrupted one can be resumed."""

import json
import shutil
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

from edgemap.runtime.frames.disk import make_folder, write_atomically
from edgemap.simulation.errors import SimulationError

# What the folder holds; written first, and last of all again with `complete` set.
RECORD_NAME = "simulation.json"
_PARTS = ".parts"
Progress = Callable[[int, int], None]


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

    def fill(
        self, numbers: Sequence[int], make: Callable[[list[int]], Iterable[object]], progress: Progress, each: int = 1
    ) -> list[Any]:
        """Makes the parts that are missing and returns the contents of all parts' files. make: makes parts one after
        the other. progress: called with what is done and all, in units of which a part has `each`."""
        paths = [self.part_of(self.folder, number) for number in numbers]
        missing = [number for number, path in zip(numbers, paths, strict=True) if not path.is_file()]
        done = len(numbers) - len(missing)
        progress(done * each, len(numbers) * each)
        for number, _ in enumerate(make(missing), start=done + 1):
            progress(number * each, len(numbers) * each)
        return [json.loads(path.read_text()) for path in paths]

    def finish(self) -> None:
        """Everything is written: forget the parts."""
        write_atomically(self.folder / RECORD_NAME, json.dumps({**self._settings, "complete": True}, indent=1))
        shutil.rmtree(self.parts)
