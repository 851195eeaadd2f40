"""Which bundle a source gets where none is named: rendered pictures and those of a lens have one each."""

from __future__ import annotations

from pathlib import Path

from edgemap.geometry.errors import EdgemapError

RENDERED, LENS = "edgemap-nano", "yolox-nano"
RENDERED_KINDS = ("sim", "drive")
SIMULATION_FILE = "simulation.json"  # lies in what `edgemap simulate` writes


def default_bundle(*specs: str) -> tuple[str, str]:
    """The bundle's name for sources `SPEC...`, and why: `edgemap-nano` only where every one of them is rendered.

    `demo`, `sim:SEED` and `drive:DIR` count as rendered, as do a recording of one of them and pictures that
    `edgemap simulate` wrote.
    """
    real = next((spec for spec in specs if not _is_rendered(spec)), None)
    if real is None:
        return RENDERED, f"{', '.join(specs[:3])} counts as rendered"
    return LENS, f"{real} comes from a lens"


def _is_rendered(spec: str) -> bool:
    if spec.partition("#")[0].endswith(".mcap"):
        recorded = _recorded_from(spec)
        return recorded is not None and _is_rendered(recorded)
    kind, _, folder = spec.partition(":")
    return spec == "demo" or kind in RENDERED_KINDS or bool(folder and (Path(folder) / SIMULATION_FILE).is_file())


def _recorded_from(spec: str) -> str | None:
    """SPEC of the camera that a recording of ours was made with; None for another file or a broken one."""
    from edgemap.runtime.recordings.facts import RECORD
    from edgemap.runtime.recordings.reader import McapReading

    try:
        recording = McapReading(Path(spec.partition("#")[0]).expanduser())
    except EdgemapError:  # opening the camera says what is wrong with it
        return None
    recording.close()
    return recording.metadata.get(RECORD, {}).get("camera")
