#!/usr/bin/env python
"""The pictures of README and docs: `make demo`, some minutes.

Runs the demo with its live page, looks at that in chromium without a window, and keeps what it shows at every
`EVERY`th frame of the drive and at its end as one animated WebP, docs/demo.webp; then the page and the report, on a
desktop and a phone. The page states the drive's own rate instead of the measured one, so that a busy machine makes the
same pictures. Needs chromium and the extras view and simulation.
"""

import io
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from PIL import Image

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT / "tests"))
from support.browser import Browser, Page  # noqa: E402

EVERY, SHOWN_MS, LAST_MS = 10, 125, 3000  # frames of the drive at 10 Hz between two pictures: it plays 8 times as fast
SIZE, PHONE, SCALE = (1440, 900), (390, 844), 0.67  # of the windows, and of the moving picture
LARGEST_BYTES = 3 << 20
RUN = """
from edgemap.cli import main
from edgemap.view import status
from edgemap.view.page import LivePage

LivePage.rate_hz = lambda page: page.camera_hz()
status.SILENT_S = float("inf")
main()
"""


def pictures(page: Page, frames: int) -> list[Image.Image]:
    """What the page shows at every `EVERY`th frame, at most one picture for each, and at the end."""
    shown = []
    for frame in [*range(0, frames, EVERY), frames]:
        page.until(f"edgemap.frame >= {frame} || edgemap.state === 'finished'")
        time.sleep(1.0 if frame == frames else 0.0)  # the list draws the end
        whole = Image.open(io.BytesIO(page.picture())).convert("RGB")
        shown.append(whole.resize((round(SIZE[0] * SCALE), round(SIZE[1] * SCALE)), Image.Resampling.LANCZOS))
        print(f"\r{frame} of {frames}", end="", file=sys.stderr, flush=True)
    return shown


def stills(browser: Browser, url: str, report: Path) -> None:
    """The pictures of docs/live-page.md and docs/first-map.md."""
    choose, slider = "edgemap.map.pickedBy('chair-1')", "document.getElementById('replay-at')"
    for name, address, size, scheme, action in (
        ("page.webp", url, SIZE, "light", "0"),
        ("page-object.webp", url, SIZE, "light", choose),
        ("page-dark.webp", url, SIZE, "dark", "0"),
        ("page-phone.webp", url, PHONE, "light", choose),
        ("report.webp", report.as_uri(), SIZE, "light", f"{slider}.value = 40; {slider}.oninput()"),
    ):
        page = browser.open(address, *size, prefers_color_scheme=scheme)
        page.until("window.edgemap?.updates > 0 && edgemap.map.objects.size > 0")
        time.sleep(2.0)
        page.value(f"{action}; true")
        time.sleep(1.5)  # the map eases to its new place
        shown = Image.open(io.BytesIO(page.picture())).convert("RGB")
        shown.save(ROOT / "docs" / name, quality=80, method=6)
        page.close()


def main() -> None:
    """Make them."""
    out = ROOT / "docs" / "demo.webp"
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-u", "-c", RUN, "run", "--view", "127.0.0.1:0", "--out", f"{folder}/run"]
        run = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        assert run.stdout is not None
        url = run.stdout.readline().split()[-1]
        browser = Browser(Path(folder) / "chromium")
        try:
            page = browser.open(url, *SIZE, prefers_color_scheme="light")
            page.until("window.edgemap?.updates > 0")
            shown = pictures(page, 600)
            stills(browser, url, Path(folder) / "run" / "report.html")
        finally:
            browser.close()
            run.terminate()
            run.communicate()
    times = [SHOWN_MS] * (len(shown) - 1) + [LAST_MS]
    for quality in range(70, 10, -10):
        shown[0].save(out, save_all=True, append_images=shown[1:], duration=times, loop=0, quality=quality, method=4)
        if out.stat().st_size <= LARGEST_BYTES:
            break
    print(f"\n{out}: {len(shown)} pictures, {out.stat().st_size / 1e6:.1f} MB, quality {quality}")


if __name__ == "__main__":
    main()
