"""Why a map is as it is: the findings of a verdict and the faults of a run, gathered by cause, the gravest first."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from edgemap.geometry.errors import EdgemapError
from edgemap.geometry.map_object import MapObject
from edgemap.runtime.frames.errors import RunFolderError
from edgemap.runtime.frames.reading import decode_json, error_line, printable, read_bytes
from edgemap.runtime.outputs.verdict.causes import Cause, cause_of_fault
from edgemap.runtime.outputs.verdict.verdict import Verdict, verdict_of
from edgemap.runtime.step.map_file import load_map

RUN_BYTES = 16 << 20
SHOWN_FAULTS = 3  # of one cause


@dataclass(frozen=True, slots=True)
class Step:
    """One cause with what speaks for it. counted: whether the verdict rests on it, or faults alone name it."""

    cause: Cause
    evidence: tuple[str, ...]
    counted: bool


def explain(record: Mapping[str, Any], objects: Sequence[MapObject]) -> tuple[Verdict, list[Step]]:
    """The verdict and its causes in order; faults of causes that the verdict does not name come last. Raises
    RunFolderError where fields of the record are of other kinds.
    """
    try:
        return _explained(record, objects)
    except (LookupError, TypeError, ValueError, AttributeError, ArithmeticError) as error:
        raise RunFolderError(f"run.json: damaged, or of another version ({error_line(error)})") from None


def _explained(record: Mapping[str, Any], objects: Sequence[MapObject]) -> tuple[Verdict, list[Step]]:
    verdict = verdict_of(record, objects)
    found: dict[Cause, list[str]] = {}
    for finding in verdict.findings:
        found.setdefault(finding.cause, []).append(finding.text)
    faults: dict[Cause, int] = {}
    for text in record.get("faults", []):
        cause = cause_of_fault(str(text))
        if cause is None:
            continue
        faults[cause] = faults.get(cause, 0) + 1
        if faults[cause] <= SHOWN_FAULTS:
            evidence, shown = found.setdefault(cause, []), printable(text)
            if (finding := shown.partition(": ")[2]) in evidence:  # the same, without its frame
                evidence.remove(finding)
            evidence.append(shown)
    counted = {finding.cause for finding in verdict.findings}
    return verdict, [Step(cause, tuple(dict.fromkeys(evidence)), cause in counted) for cause, evidence in found.items()]


def read_record(path: Path) -> dict[str, Any]:
    """A run.json. Raises RunFolderError."""
    return decode_json(read_bytes(path, RUN_BYTES, RunFolderError), dict, path, RunFolderError)


def read_run(folder: Path) -> tuple[dict[str, Any], list[MapObject]]:
    """run.json and the objects of map.json. Raises RunFolderError or MapError."""
    return read_record(folder / "run.json"), load_map(folder)


def verdict_or_none(record: Mapping[str, Any], objects: Sequence[MapObject]) -> Verdict | None:
    """The verdict of a record that may be of an older edgemap, or damaged; None where it cannot be judged."""
    try:
        return explain(record, objects)[0]
    except EdgemapError:
        return None
