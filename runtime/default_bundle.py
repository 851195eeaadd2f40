"""Which bundle a source gets where none is named: rendered pictures and those of a lens have one each."""

from pathlib import Path

from edgemap.geometry.errors import EdgemapError
from edgemap.runtime.reading import user_path

RENDERED, LENS = "edgemap-nano", "edgemap-pico"
RENDERED_KINDS = ("sim", "drive")
RECORDED_DEPTH = 3
SIMULATION_FILE = "simulation.json"  # lies in what `edgemap simulate` writes


def default_bundle(*specs: str) -> tuple[str, str]:
    """The bundle's name for sources `SPEC...`, and why: `edgemap-nano` only where every one of them is rendered.

    `demo`, `sim:SEED` and `drive:DIR` count as rendered, as do a recording of one of them and pictures that
    `edgemap simulate` wrote.
    """
    real = next((spec for spec in specs if not _is_rendered(_recorded_from(spec))), None)
    if real is None:
        return RENDERED, f"{', '.join(specs[:3])} counts as rendered"
    return LENS, f"{real} comes from a lens"


def _is_rendered(spec: str) -> bool:
    kind, _, folder = spec.partition(":")
    return spec == "demo" or kind in RENDERED_KINDS or bool(folder and (Path(folder) / SIMULATION_FILE).is_file())


def _recorded_from(spec: str) -> str:
    """SPEC of the camera that a recording of ours was made with, through recordings of recordings; else as it is."""
    for _ in range(RECORDED_DEPTH):  # a file may name itself
        if not spec.partition("#")[0].endswith(".mcap"):
            break
        spec = _camera_of(spec) or ""
    return spec


def _camera_of(spec: str) -> str | None:
    """What a recording says that it was made with; None for one that is not ours, or broken."""
    from edgemap.runtime.recordings.facts import RECORD
    from edgemap.runtime.recordings.reader import McapReading

    try:
        recording = McapReading(user_path(spec.partition("#")[0]))
    except EdgemapError:  # opening the camera says what is wrong with it
        return None
    recording.close()
    return recording.metadata.get(RECORD, {}).get("camera")
