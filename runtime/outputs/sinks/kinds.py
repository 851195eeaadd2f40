"""Kinds of sinks by entry point (group `edgemap.sinks`): of other packages, and our bridges."""

import os
import socket
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from importlib.metadata import EntryPoint
from pathlib import Path
from typing import Any

from edgemap.geometry.camera.floor import FloorCamera
from edgemap.geometry.errors import EdgemapError
from edgemap.geometry.map_object import MapObject
from edgemap.runtime.frames.camera import Camera
from edgemap.runtime.frames.errors import PluginError, UsageError
from edgemap.runtime.frames.faults import Fault
from edgemap.runtime.frames.inference import Inference
from edgemap.runtime.frames.plugins import SINKS, load_plugin, plugins
from edgemap.runtime.frames.reading import error_line, print_message
from edgemap.runtime.outputs.verdict.verdict import Verdict
from edgemap.runtime.step.edit_queue import Edits
from edgemap.runtime.step.sinks import Sink, raised
from edgemap.runtime.step.slam import StepResult


@dataclass(frozen=True, slots=True)
class RunInfo:
    """The run that a sink is opened for.

    folder: of the run. camera: the source; floor: its lens and mount. edits: of the map; a sink may submit some. robot:
    name of the robot, $EDGEMAP_ROBOT or the machine's. inference: engine and precision. saved: a map that is continued.
    guess: of lens and mount, as in run.json. verdict: how far the map can be trusted so far. classes: of the detector;
    threshold: of their scores.
    """

    folder: Path
    camera: Camera
    floor: FloorCamera
    edits: Edits
    inference: Inference
    saved: Path | None = None
    guess: dict[str, Any] | None = None
    verdict: Callable[[], Verdict] = lambda: Verdict("care")
    classes: tuple[str, ...] = ()
    threshold: float = 0.0
    robot: str = field(default_factory=lambda: os.environ.get("EDGEMAP_ROBOT") or socket.gethostname())


def open_sinks(asked: Mapping[str, str], run: RunInfo) -> list[Sink]:
    """The sinks of these names, each with its address, in order.

    What fails in one of another package is a fault of the run and never its end. Raises UsageError for a name that no
    package has, and what one of ours raises where it cannot be opened.
    """
    kinds = plugins(SINKS)
    sinks: list[Sink] = []
    for name, address in asked.items():
        if name not in kinds:
            raise UsageError(f"--sink {name}: no such sink; installed are {', '.join(sorted(kinds))}")
        opened = partial(_opened, kinds[name], address, run)
        sinks.append(opened() if kinds[name].value.startswith("edgemap.") else PluginSink(name, opened))
    return sinks


def _opened(point: EntryPoint, address: str, run: RunInfo) -> Sink:
    return load_plugin(point).open(address, run)


class PluginSink(Sink):
    """A sink of another package. A failure to open it is raised by every `write`, so that the run reports it once, and
    a failure to close it is printed."""

    def __init__(self, name: str, opened: Callable[[], Sink]) -> None:
        self.name = name
        self._sink: Any = None
        self._failure: EdgemapError = PluginError("its package gave no sink")
        try:
            self._sink = opened()
        except EdgemapError as error:
            self._failure = error
        except raised() as error:
            self._failure = PluginError(f"does not open ({error_line(error)})")

    def write(self, result: StepResult, objects: list[MapObject]) -> None:
        """Passes a step on. Raises what the sink raises."""
        if self._sink is None:
            raise self._failure
        self._sink.write(result, objects)

    def last(self, result: StepResult, objects: list[MapObject]) -> None:
        """Passes the boxes on that came after the last frame, where the sink takes them."""
        getattr(self._sink, "last", lambda *_: None)(result, objects)

    def fault(self, fault: Fault) -> None:
        """Passes a fault on."""
        if self._sink is not None:
            self._sink.fault(fault)

    def close(self) -> None:
        """Closes the sink."""
        try:
            if self._sink is not None:
                self._sink.close()
        except raised() as error:  # as when it is opened
            print_message(f"sink {self.name}: does not close ({error_line(error)})")
