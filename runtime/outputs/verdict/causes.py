"""Why maps go wrong, and what to do (causes.toml): each cause has a section of docs/troubleshooting.md."""

from pathlib import Path

import msgspec

from edgemap.runtime.frames.faults import FaultKind

PAGE = "docs/troubleshooting.md"


class Cause(msgspec.Struct, frozen=True):
    """title: in a few words. remedy: what to do, in one or two sentences. anchor: of docs/troubleshooting.md. kinds: of
    the faults that lead here."""

    title: str
    remedy: str
    anchor: str
    kinds: frozenset[FaultKind] = frozenset()

    def __post_init__(self) -> None:
        msgspec.structs.force_setattr(self, "remedy", self.remedy.replace("\n", " "))

    @property
    def link(self) -> str:
        """Address of the documentation section."""
        return f"{PAGE}#{self.anchor}"


CAUSES = msgspec.toml.decode(Path(__file__).with_suffix(".toml").read_bytes(), type=dict[str, Cause])
CAUSE_OF = {kind: cause for cause in CAUSES.values() for kind in cause.kinds}  # of the faults that lead to one
