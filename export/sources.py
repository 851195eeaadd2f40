"""Published models: where their files come from, upstream first, and the sums that the files must have."""

import tomllib
from pathlib import Path

import msgspec


class KnownModel(msgspec.Struct, frozen=True):
    """A file that `edgemap pull` can fetch. sums: SHA-256 values, any of which is right. confidence, sure_confidence:
    as in the manifest.
    """

    name: str
    file: str
    sums: tuple[str, ...]
    licence: str
    urls: tuple[str, ...] = ()
    confidence: float = 0.3
    sure_confidence: float = 0.0


_TABLES = tomllib.loads(Path(__file__).with_suffix(".toml").read_text())
KNOWN = {name: msgspec.convert(entry | {"name": name}, KnownModel) for name, entry in _TABLES.items()}
