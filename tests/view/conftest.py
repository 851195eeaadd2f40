import threading
from contextlib import ExitStack, closing
from dataclasses import asdict, replace

import numpy as np
import pytest
from support.steps import Steps

from edgemap.geometry.grid.occupancy_grid import OccupancyGrid
from edgemap.runtime.frames.colours import SHAPES, label_mark
from edgemap.runtime.frames.faults import Fault, FaultKind

pytest.importorskip("starlette", reason="the live page needs the extra 'view'")
pytest.importorskip("uvicorn", reason="the live page needs the extra 'view'")
pytest.importorskip("websockets", reason="the live page needs the extra 'view'")

ABOUT = {
    "camera": "made", "live": False, "frames": 100, "rate_hz": 10.0, "bundle": "painted", "odometry": "truth",
    "folder": "runs/made", "picture_px": [320, 240], "view_rad": 1.0, "chi2_95": 5.991,
    "lens": {"fx": 293.0, "fy": 293.0, "cx": 159.5, "cy": 119.5, "distortion": {"model": "none", "coefficients": []}},
    "mount": {"height_m": 0.6, "pitch_deg": 11.5, "roll_deg": 2.0, "forward_m": 0.1, "left_m": 0.0},
    "marks": {name: asdict(label_mark(name)) for name in ("chair", "couch", "person")}, "shapes": SHAPES,
}  # fmt: skip


class Served:
    """A page of made-up steps on a server of its own."""

    def __init__(self, folder, host="127.0.0.1", port=0, live=False, steps=0):
        from edgemap.view.page import LivePage
        from edgemap.view.pause import Pause
        from edgemap.view.server import PageServer

        self.steps = Steps()
        self.stepping = threading.Lock()
        self.page = LivePage(ABOUT | {"live": live}, folder, None if live else Pause())
        self.server = PageServer(self.page, host, port)
        self._over = threading.Event()
        threading.Thread(target=self._take_edits, daemon=True).start()
        self.port, self.token = self.server.port, self.server.token
        self.url = self.server.url
        self.step(steps)

    def step(self, count=1):
        with self.stepping:
            self.steps.into(self.page, count)

    def fault(self, text):
        """A step whose odometry reports a fault."""
        fault = Fault(FaultKind.ODOMETRY, text)
        self.page.write(*self.steps.next(fault))
        self.page.fault(fault)

    def sees_a_room(self):
        """One of 3 x 4 m whose walls are obstacles."""
        odds = np.full((84, 64), 40, np.int8)
        odds[2:82, 2:62] = -40
        result, objects = self.steps.next()
        self.page.write(replace(result, grid=OccupancyGrid(odds, 1.0, -1.0, 0.05)), objects)

    def close(self):
        self._over.set()
        self.server.close()

    def _take_edits(self):
        """As a run that is held: edits are taken between two steps."""
        while not self._over.wait(0.005):
            with self.stepping:
                self.page.edits.apply(self.steps.mapper, self.steps.index)


@pytest.fixture
def serve(tmp_path):
    """serve(host=…, port=…, live=…, steps=…) -> Served; all are closed at the end."""
    with ExitStack() as served:
        yield lambda **options: served.enter_context(closing(Served(tmp_path, **options)))


@pytest.fixture
def look(browser):
    """look(served, …) -> a tab at its page with the first update shown; at the end all are closed, none complained."""
    tabs = []

    def open_tab(served, **options):
        tabs.append(browser.open(served.url, **options))
        tabs[-1].until("window.edgemap?.updates > 0")
        return tabs[-1]

    yield open_tab
    for tab in tabs:
        assert tab.said("Runtime.exceptionThrown") == []
        tab.close()


@pytest.fixture
def watched(serve, look):
    """watched(steps, …) -> a run of so many steps and a tab that shows the last one; options are those of `look`."""

    def opened(steps, **options):
        served = serve(steps=steps)
        tab = look(served, **options)
        shown = f"edgemap.map.objects.size === {len(served.page.objects)} && !edgemap.map.asked"
        tab.until(f"edgemap.frame === {steps - 1} && {shown}")
        return served, tab

    return opened
