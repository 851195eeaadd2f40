"""Debian's chromium without a window, driven by the Chrome DevTools Protocol over one WebSocket."""

import base64
import itertools
import json
import shutil
import subprocess
from contextlib import ExitStack, suppress
from pathlib import Path

from support.waiting import wait_for
from websockets.sync.client import connect

LIMIT_S = 20.0
FLAGS = (
    "--headless=new", "--no-sandbox", "--disable-gpu", "--remote-debugging-port=0", "--no-first-run",
    "--hide-scrollbars", "--disable-background-networking", "--disable-component-update", "--disable-sync",
    "--disable-dev-shm-usage",
    "--disable-extensions", "--mute-audio", "--no-proxy-server", "--disable-features=Translate,MediaRouter",
)  # fmt: skip


def find_chromium() -> str | None:
    return next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)


class BrowserError(Exception):
    """What chromium refused to do."""


class Browser:
    """One chromium process; `open` gives pages. Events of all pages are kept in `events`."""

    def __init__(self, profile: Path) -> None:
        command = [find_chromium() or "chromium", *FLAGS, f"--user-data-dir={profile}", "about:blank"]
        self.process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        address = profile / "DevToolsActivePort"
        wait_for(lambda: address.is_file() and address.read_text().count("\n") >= 1, "chromium's port")
        port, path = address.read_text().split("\n")[:2]
        self._opened = ExitStack()
        self._socket = self._opened.enter_context(connect(f"ws://127.0.0.1:{port}{path}", max_size=None, proxy=None))
        self._numbers = itertools.count(1)
        self.events: list[dict] = []

    def call(self, method: str, session: str | None = None, **params):
        number = next(self._numbers)
        message = {"id": number, "method": method, "params": params} | ({"sessionId": session} if session else {})
        self._socket.send(json.dumps(message))
        while True:
            answer = json.loads(self._socket.recv(timeout=LIMIT_S))
            if answer.get("id") == number:
                if "error" in answer:
                    raise BrowserError(f"{method}: {answer['error']}")
                return answer["result"]
            self.events.append(answer)

    def open(self, url: str, width: int = 1440, height: int = 900, *, new_window: bool = True, **media: str) -> "Page":
        target = self.call("Target.createTarget", url="about:blank", newWindow=new_window)["targetId"]
        session = self.call("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        page = Page(self, target, session)
        for domain in ("Page", "Runtime", "Log", "Network"):
            page.call(f"{domain}.enable")
        page.resize(width, height)
        if media:
            features = [{"name": name.replace("_", "-"), "value": value} for name, value in media.items()]
            page.call("Emulation.setEmulatedMedia", features=features)
        page.call("Page.navigate", url=url)
        return page

    def close(self) -> None:
        self._opened.close()
        self.process.terminate()
        self.process.wait(timeout=LIMIT_S)


class Page:
    """One tab."""

    def __init__(self, browser: Browser, target: str, session: str) -> None:
        self.browser, self.target, self.session = browser, target, session

    def call(self, method: str, **params):
        return self.browser.call(method, self.session, **params)

    def resize(self, width: int, height: int, scale: float = 1.0) -> None:
        size = {"width": width, "height": height, "deviceScaleFactor": scale, "mobile": width < 500}
        self.call("Emulation.setDeviceMetricsOverride", **size)

    def value(self, expression: str):
        answer = self.call("Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True)
        assert "exceptionDetails" not in answer, answer["exceptionDetails"]
        return answer["result"].get("value")

    def until(self, expression: str):
        """Wait until it is true."""

        def holds():
            with suppress(BrowserError):  # between two pages
                return self.value(f"Boolean({expression})")

        return wait_for(holds, expression)

    def click(self, identity: str) -> None:
        self.value(f"document.getElementById({identity!r}).click()")

    def box(self, selector: str) -> list[float]:
        """left, top, right, bottom of an element, px."""
        edges = "(b => [b.left, b.top, b.right, b.bottom])"
        return self.value(f"{edges}(document.querySelector({selector!r}).getBoundingClientRect())")

    def picture(self) -> bytes:
        """What it shows, as PNG."""
        return base64.b64decode(self.call("Page.captureScreenshot", format="png")["data"])

    def said(self, *methods: str) -> list[dict]:
        """What happened in this tab so far, of these kinds."""
        self.value("0")
        own = (event for event in self.browser.events if event.get("sessionId") == self.session)
        return [event["params"] for event in own if event["method"] in methods]

    def close(self) -> None:
        self.browser.call("Target.closeTarget", targetId=self.target)
