"""`python scripts/moving_picture.py docs/images/demo.webp`: the live page during the demo, as the README shows it.

Drives the installed Chromium as the page's tests do. Takes the minute that the demo lasts.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from pathlib import Path

from PIL import Image

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from support.browser import Browser

WIDTH, HEIGHT, SHOWN_WIDTH = 1280, 760, 960  # px of the window, and of the picture
EVERY_S, LAST_S = 0.75, 62.0
PORT = 8097


def main(path: Path) -> None:
    """Record the page and write an animated WebP."""
    with tempfile.TemporaryDirectory() as folder:
        command = [
            sys.executable,
            "-m",
            "edgemap.cli",
            "run",
            "--view",
            "--view-port",
            str(PORT),
            "--out",
            f"{folder}/run",
        ]
        run, browser = subprocess.Popen(command), Browser(Path(folder) / "profile")
        try:
            time.sleep(4.0)  # the page stands before the first frame
            page = browser.open(f"http://127.0.0.1:{PORT}/", WIDTH, HEIGHT)
            shots, begun_s = [], time.monotonic()
            while time.monotonic() - begun_s < LAST_S:
                shot = Path(folder) / "shot.png"
                page.screenshot(shot)
                with Image.open(shot) as image:
                    shots.append(image.convert("RGB").resize((SHOWN_WIDTH, SHOWN_WIDTH * HEIGHT // WIDTH)))
                time.sleep(max(0.0, begun_s + EVERY_S * len(shots) - time.monotonic()))
        finally:
            browser.close()
            run.terminate()
            run.wait()
    path.parent.mkdir(parents=True, exist_ok=True)
    shots[0].save(path, save_all=True, append_images=shots[1:], duration=200, loop=0, quality=55, method=6)
    print(f"{path}: {len(shots)} pictures, {path.stat().st_size / 1e6:.1f} MB")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
