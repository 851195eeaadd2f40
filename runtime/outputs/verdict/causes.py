"""Why maps go wrong, and what to do (causes.toml): each cause has a section of docs/troubleshooting.md."""

import tomllib
from dataclasses import dataclass
from pathlib import Path

from edgemap.runtime.frames.faults import FaultKind

PAGE = "docs/troubleshooting.md"


@dataclass(frozen=True, slots=True)
class Cause:
    """title: in a few words. remedy: what to do, in one or two sentences. anchor: of docs/troubleshooting.md. kinds: of
    the faults that lead here."""

    title: str
    remedy: str
    anchor: str
    kinds: frozenset[FaultKind] = frozenset()

    @property
    def link(self) -> str:
        """Address of the documentation section."""
        return f"{PAGE}#{self.anchor}"


def _cause(title: str, remedy: str, anchor: str, kinds: tuple[str, ...] = ()) -> Cause:
    return Cause(title, remedy.replace("\n", " "), anchor, frozenset(map(FaultKind, kinds)))


CAUSES = {
    name: _cause(**entry) for name, entry in tomllib.loads(Path(__file__).with_suffix(".toml").read_text()).items()
}
_BY_KIND = {kind: cause for cause in CAUSES.values() for kind in cause.kinds}


def cause_of(kind: FaultKind) -> Cause | None:
    """The cause that faults of a kind lead to; None where there is none."""
    return _BY_KIND.get(kind)
