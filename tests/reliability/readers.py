"""Hostile files, first fuzzer: every reader on valid documents with values, structure and bytes mutated."""

from __future__ import annotations

from pathlib import Path

from reliability.parts import PartReport
from reliability.reader_cases import cases
from reliability.workers import INPUTS, examine


def run(seed: int, share: float, out: Path) -> PartReport:
    """20,000 mutated documents for every reader. out: failing inputs are kept here."""
    return examine(cases, seed, max(1, round(INPUTS * share)), out)
