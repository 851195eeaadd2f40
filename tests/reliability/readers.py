"""The property tests of the readers with many more mutated files than `make test` takes."""

from pathlib import Path

from reliability.fuzz import TESTS, run_tests
from reliability.parts import PartReport

INPUTS = 20_000  # of each reader, at full size
FILES = ("runtime/test_readers.py", "bridges/recordings/test_damaged_recordings.py", "export/test_model_readers.py")


def run(seed: int, share: float, out: Path) -> PartReport:
    """Every reader on mutated files. out: the tests' output."""
    sizes = {"EDGEMAP_EXAMPLES": str(max(1, round(INPUTS * share)))}
    return run_tests([TESTS / file for file in FILES], sizes, seed, out)
