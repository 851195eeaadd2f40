"""axe-core in a tab: what of a page keeps people with other eyes and hands out."""

import os
from importlib.util import find_spec
from pathlib import Path

from support.browser import Page

ROOT = Path(__file__).parents[2]
SERIOUS = ("serious", "critical")


def find_axe() -> Path | None:
    """axe.min.js: of $EDGEMAP_AXE, of npm (`npm install --no-save axe-core`), or of the package axe-core-python."""
    wheel = find_spec("axe_core_python")
    places = [Path(os.environ.get("EDGEMAP_AXE", "-")), ROOT / "node_modules" / "axe-core" / "axe.min.js"]
    places += [Path(wheel.origin).parent / "axe.min.js"] if wheel and wheel.origin else []
    return next((place for place in places if place.is_file()), None)


def serious_faults(tab: Page) -> list[str]:
    """Rule, help and first element of each serious or critical fault of what the tab shows."""
    axe = find_axe()
    assert axe is not None
    tab.value(axe.read_text() + "; true")
    found = tab.value("axe.run(document, {resultTypes: ['violations']}).then((told) => told.violations)")
    found = [fault | {"html": fault["nodes"][0]["html"][:120]} for fault in found if fault["impact"] in SERIOUS]
    return ["{id} ({impact}): {help}: {html}".format_map(fault) for fault in found]
