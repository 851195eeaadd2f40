"""`edgemap run --view`: opens the live page of a run, or a null object without the flag."""

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from threading import Event
from typing import TYPE_CHECKING, Any

from edgemap.cli.publishers import WatchGroup
from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.camera import Camera
from edgemap.runtime.frames.option_texts import host_and_port
from edgemap.runtime.inputs.cameras.wrappers import PacedCamera
from edgemap.runtime.outputs.verdict.verdict import Verdict
from edgemap.runtime.step.edit_queue import Edits
from edgemap.runtime.step.loop import stop_on_signals
from edgemap.runtime.step.sinks import Sink
from edgemap.view.report.crops import BestCrops

if TYPE_CHECKING:
    from edgemap.view.page import LivePage

LOOK_EVERY_S = 0.1


class NoPage:
    """Null object for a run without a live page."""

    sinks: Sequence[Sink] = ()

    def camera(self, source: Camera, stop: Event) -> Camera:  # noqa: ARG002
        """The camera as it is."""
        return source

    def judged_by(self, verdict: Callable[[], Verdict]) -> None:
        """Ignored."""

    def stay(self, stop: Event, meanwhile: Callable[[], object]) -> None:
        """Returns at once."""

    def drives(self, goals: Sequence[Callable[[SE2], None]]) -> None:
        """Ignored."""


class OpenPage(NoPage):
    """A run with a page. A file source is paced by its stamps and can be paused; a live camera runs on."""

    def __init__(self, page: "LivePage", url: str) -> None:
        self.sinks = (page,)
        self._page, self._pause, self._url = page, page.pause, url

    def camera(self, source: Camera, stop: Event) -> Camera:
        """The camera that the run reads from."""
        from edgemap.view.pause import PausableCamera

        if self._pause is None:
            return source
        return PausableCamera(PacedCamera(source, self._pause.running_s), self._pause, stop.is_set)

    def judged_by(self, verdict: Callable[[], Verdict]) -> None:
        """Sets the function that gives the map's verdict."""
        self._page.verdict = verdict

    def drives(self, goals: Sequence[Callable[[SE2], None]]) -> None:
        """Adds receivers of goal poses."""
        self._page.goals += goals

    def stay(self, stop: Event, meanwhile: Callable[[], object]) -> None:
        """Keeps serving after the end of a run, until Ctrl-C. meanwhile: called repeatedly."""
        if stop.is_set():
            return
        print(f"the page stays at {self._url}  (Ctrl-C ends it)", flush=True)
        with stop_on_signals() as enough:
            while not enough.is_set():
                meanwhile()
                time.sleep(LOOK_EVERY_S)


@contextmanager
def live_page(
    options: WatchGroup,
    source: Camera,
    about: dict[str, Any],
    folder: Path,
    crops: BestCrops,
    edits: Edits,
    keep_mount: Callable[[float, float], Path],
    searching: Callable[[], bool] = bool,
) -> Iterator[NoPage]:
    """The page of a run while the block lasts. about: of `about_run`.

    Raises MissingExtraError, or ViewError where the address is taken.
    """
    if options.view is None:
        yield NoPage()
        return
    from edgemap.runtime.frames.extras import need

    need("view", "--view")
    from edgemap.view.page import LivePage
    from edgemap.view.pause import Pause
    from edgemap.view.server import PageServer

    pause = None if source.live else Pause()
    page = LivePage(about, folder, pause, lambda: source.state, crops, edits)
    page.searching, page.keep_mount = searching, keep_mount
    server = PageServer(page, *host_and_port(options.view, "--view", 8090))
    try:
        print(f"live page:  {server.url}", flush=True)
        yield OpenPage(page, server.url)
    finally:
        server.close()
