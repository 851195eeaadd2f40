"""A progress line on the terminal."""

import sys

from tqdm import tqdm

from edgemap.geometry.objects.map_object import MapObject
from edgemap.runtime.reading import printable
from edgemap.runtime.slam import StepResult


class Progress:
    """Frames done, speed and objects, on stderr; silent where stderr is no terminal. total: None for live cameras."""

    name = "progress line"

    def __init__(self, total: int | None) -> None:
        self._bar = tqdm(total=total, unit=" frames", disable=not sys.stderr.isatty(), file=sys.stderr, leave=False)
        self._shown: str | None = None

    def write(self, result: StepResult, objects: list[MapObject]) -> None:
        """Move on by one frame."""
        pose = result.pose_map_base
        self._bar.set_postfix_str(f"{len(objects)} objects, at x {pose.x_m:.2f} m y {pose.y_m:.2f} m", refresh=False)
        self._bar.update()

    def fault(self, text: str) -> None:
        """Say it once above the line."""
        if text != self._shown and not self._bar.disable:
            self._shown = text
            self._bar.write(printable(text), file=sys.stderr)

    def close(self) -> None:
        """End the line."""
        self._bar.close()
