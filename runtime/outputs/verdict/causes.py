"""Why maps go wrong, and what to do (causes.toml): each cause has a section of docs/troubleshooting.md, to which faults
lead too."""

import re
import tomllib
from dataclasses import dataclass
from pathlib import Path

PAGE = "docs/troubleshooting.md"


@dataclass(frozen=True, slots=True)
class Cause:
    """title: in a few words. remedy: what to do, in one or two sentences. anchor: of docs/troubleshooting.md. faults:
    pattern of the words of faults that lead here; empty for none."""

    title: str
    remedy: str
    anchor: str
    faults: str = ""

    @property
    def link(self) -> str:
        """Address of the documentation section."""
        return f"{PAGE}#{self.anchor}"


CAUSES = {
    name: Cause(**entry | {"remedy": entry["remedy"].replace("\n", " ")})
    for name, entry in tomllib.loads(Path(__file__).with_suffix(".toml").read_text()).items()
}


def cause_of_fault(text: str) -> Cause | None:
    """The documentation section about a fault: the first whose words fit; None where there is none."""
    words = ((cause, cause.faults) for cause in CAUSES.values() if cause.faults)
    return next((cause for cause, pattern in words if re.search(pattern, text, re.IGNORECASE)), None)
