"""`edgemap run --view`: opens the live page of a run."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from threading import Event
from typing import TYPE_CHECKING, Any

from edgemap.cli.publishers import WatchGroup
from edgemap.runtime.frames.camera import Camera
from edgemap.runtime.frames.option_texts import host_and_port
from edgemap.runtime.inputs.cameras.wrappers import PacedCamera
from edgemap.runtime.step.edit_queue import Edits
from edgemap.runtime.step.loop import stop_on_signals
from edgemap.view.report.crops import BestCrops

if TYPE_CHECKING:
    from edgemap.view.page import LivePage

LOOK_EVERY_S = 0.1
WITHOUT = ",without-pictures"


class OpenPage:
    """A run's page and its server. A file source is paced by its stamps and can be paused; a live camera runs on."""

    def __init__(self, page: "LivePage", url: str) -> None:
        self.page, self._url = page, url

    def camera(self, source: Camera, stop: Event) -> Camera:
        """The camera that the run reads from."""
        from edgemap.view.pause import PausableCamera

        pause = self.page.pause
        self.page.camera_hz = lambda: source.info.rate_hz
        return source if pause is None else PausableCamera(PacedCamera(source, pause.running_s), pause, stop.is_set)

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
) -> Iterator[OpenPage | None]:
    """The page of a run while the block lasts, None without `--view`. about: of `about_run`.

    Raises MissingExtraError, or ViewError where the address is taken.
    """
    if options.view is None:
        yield None
        return
    from edgemap.view.page import LivePage
    from edgemap.view.pause import Pause
    from edgemap.view.server import PageServer

    address, alone = options.view.removesuffix(WITHOUT), options.view.endswith(WITHOUT)
    pause = None if source.info.live else Pause()
    page = LivePage(about, folder, pause, lambda: source.state, crops, edits, not alone)
    page.searching, page.keep_mount = searching, keep_mount
    server = PageServer(page, *host_and_port(address or "127.0.0.1", "--view", 8090))
    try:
        print(f"live page:  {server.url}", flush=True)
        yield OpenPage(page, server.url)
    finally:
        server.close()
