"""Hostile files, second fuzzer: documents, recordings, models and requests drawn from the formats' own grammars.

Written by somebody who had not seen the readers' first fuzzer: nothing is mutated, everything is drawn.
"""

from __future__ import annotations

from pathlib import Path

from reliability import (
    generated_documents,
    generated_models,
    generated_network,
    generated_recordings,
)
from reliability.parts import PartReport
from reliability.workers import INPUTS, ReaderCase, examine


def run(seed: int, share: float, out: Path) -> PartReport:
    """20,000 inputs for every reader. out: failing inputs are kept here."""
    return examine(cases, seed, max(1, round(INPUTS * share)), out)


def cases(scratch: Path) -> list[ReaderCase]:
    """All readers, the cheap ones first."""
    rooms = (generated_documents, generated_network, generated_recordings, generated_models)
    return [case for room in rooms for case in room.cases(scratch)]
