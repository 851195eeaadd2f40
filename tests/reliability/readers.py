"""Hostile files and requests: every reader on valid inputs with values, structure and bytes mutated."""

from pathlib import Path

import cv2

from reliability.parts import PartReport
from reliability.workers import INPUTS, ReaderCase, examine


def run(seed: int, share: float, out: Path) -> PartReport:
    """20,000 mutated inputs for every reader. out: failing inputs are kept here."""
    return examine(cases, seed, max(1, round(INPUTS * share)), out)


def cases(scratch: Path) -> list[ReaderCase]:
    """Every reader, those that need torch last. scratch: a folder for what valid inputs are made from."""
    from reliability.document_cases import document_cases
    from reliability.model_cases import model_cases
    from reliability.recording_cases import recording_cases

    cv2.setNumThreads(0)  # threads do not survive the fork of a worker
    return [*document_cases(), *recording_cases(scratch), *model_cases(scratch)]
