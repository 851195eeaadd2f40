"""Readers on hostile inputs, in workers of bounded memory and time; the fuzzer's own rules.

A reader accepts, or refuses with an EdgemapError of one line. Anything else is a failure: another exception, a message
of several lines or of more than LINE_LENGTH characters, more than MEMORY_BYTES above the libraries, more than ALARM_S,
the end of the process.
"""

import json
import multiprocessing
import os
import resource
import shutil
import signal
import sys
import tempfile
import time
import traceback
from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from random import Random
from typing import Any

from edgemap.geometry.errors import EdgemapError
from edgemap.runtime.frames.reading import LINE_LENGTH
from reliability.parts import PartReport

INPUTS = 20_000  # of each reader, at full size
MEMORY_BYTES = 1 << 30
ALARM_S = 5.0  # of processor time, so that a busy machine is no failure
HUNG_S = 300.0  # without a word from a worker, which reports every 100 inputs
COUNTED = ("accepted", "refused", "failed")
KEPT = 20  # failing inputs of each reader
FINISHED = "finished.jsonl"
FIRST_PARSE = (
    "not JSON", "not YAML", "cannot be read", "not a picture", "picture is cut short", "not an MCAP", "not a torch",
    "INVALID_PROTOBUF", "not a whole ONNX", "too short", "no closing bracket", "is neither [section]",
    "damaged recording", "not a Darknet", "does not start with [net]", "first line must be",
)  # fmt: skip


class _TooSlow(BaseException):
    """The alarm; no reader catches it."""


@dataclass(frozen=True)
class ReaderCase:
    """make: a hostile input. read: writes it into a folder (on a memory disk) where need be, and reads it."""

    name: str
    make: Callable[[Random], Any]
    read: Callable[[Path, Any], object]


def from_file(name: str, read: Callable[[Path], object]) -> Callable[[Path, Any], object]:
    """A `ReaderCase.read` of a path: the input is written into a file of this name first."""

    def call(folder: Path, data: bytes) -> object:
        (folder / name).write_bytes(data)
        return read(folder / name)

    return call


def examine(cases: Callable[[Path], Iterable[ReaderCase]], seed: int, count: int, out: Path) -> PartReport:
    """So many inputs for every reader. cases: given a scratch folder. out: failing inputs are kept here, and what is
    finished: a run of the same seed and size goes on from there."""
    scratch = Path(tempfile.mkdtemp(prefix="edgemap-readers-", dir="/dev/shm" if Path("/dev/shm").is_dir() else None))
    done = _finished(out, seed, count)
    try:
        results = [done.get(case.name) or of_reader(case, seed, count, scratch, out) for case in cases(scratch)]
    finally:
        shutil.rmtree(scratch, ignore_errors=True)
    failures = [
        f"{result['reader']}: {number} x {what}" for result in results for what, number in result["failed"].items()
    ]
    failures += [f"{result['reader']}: only {result['past']:.0%} past the first parse" for result in results
                 if result["past"] < 1 / 3]  # fmt: skip
    return PartReport(tuple(failures), {"readers": results}, tuple(_table(results)))


def _finished(out: Path, seed: int, count: int) -> dict[str, dict[str, Any]]:
    """Results of readers that an earlier run into this folder finished, by name."""
    path = out / FINISHED
    lines = map(json.loads, path.read_text().splitlines() if path.is_file() else ())
    return {line["reader"]: line for line in lines if (line["seed"], line["inputs"]) == (seed, count)}


def of_reader(case: ReaderCase, seed: int, count: int, scratch: Path, out: Path) -> dict[str, Any]:
    """Counts of one reader; its worker is started again where an input ends it."""
    context = multiprocessing.get_context("fork")
    begun, began_s = context.Value("q", 0), time.monotonic()
    totals = {name: Counter() for name in COUNTED}
    while begun.value < count:
        receiver, sender = context.Pipe(duplex=False)
        worker = context.Process(target=_work, args=(case, seed, count, begun, scratch, out, sender), daemon=True)
        worker.start()
        sender.close()
        try:
            while receiver.poll(HUNG_S):
                for name, counter in receiver.recv().items():
                    totals[name].update(counter)
            worker.kill()
        except EOFError:
            pass
        worker.join()
        if worker.exitcode:
            totals["failed"][f"process ended ({worker.exitcode}) at input {begun.value - 1}"] += 1
    refused, accepted = totals["refused"], sum(totals["accepted"].values())
    early = sum(number for check, number in refused.items() if any(word in check for word in FIRST_PARSE))
    result: dict[str, Any] = {
        "reader": case.name, "seed": seed, "inputs": count, "accepted": accepted,
        "refused": dict(refused.most_common()), "past": 1.0 - early / count, "failed": dict(totals["failed"]),
        "seconds": time.monotonic() - began_s,
    }  # fmt: skip
    with (out / FINISHED).open("a") as file:
        file.write(json.dumps(result) + "\n")
    print(
        f"{case.name}: {count:,} inputs, {accepted:,} accepted, {dict(totals['failed']) or 'no failure'}",
        file=sys.stderr,
    )
    return result


def _work(case: ReaderCase, seed: int, count: int, begun: Any, scratch: Path, out: Path, sender: Any) -> None:
    folder = Path(tempfile.mkdtemp(dir=scratch))
    _read_once(case, folder, seed)  # libraries take their memory now
    size = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (size + MEMORY_BYTES, size + MEMORY_BYTES))
    signal.signal(signal.SIGPROF, _ring)
    os.dup2(os.open(out / "worker.log", os.O_CREAT | os.O_WRONLY | os.O_APPEND), 2)  # libraries tell what they refuse
    while begun.value < count:
        found: dict[str, Counter] = {
            "accepted": Counter(),
            "refused": Counter(),
            "failed": Counter(),
        }
        for number in range(begun.value, min(begun.value + 100, count)):
            begun.value = number + 1
            data = _made(case, f"{seed}/{case.name}/{number}")
            signal.setitimer(signal.ITIMER_PROF, ALARM_S)
            try:
                case.read(folder, data)
                found["accepted"]["accepted"] += 1
            except EdgemapError as error:
                signal.setitimer(signal.ITIMER_PROF, 0.0)  # what follows is this fuzzer's own time
                text = str(error)
                line = text.splitlines() == [text] and text.isprintable() and len(text) <= LINE_LENGTH
                found["refused" if line else "failed"][_check(text[:LINE_LENGTH])] += 1
            except (Exception, _TooSlow) as error:
                last = traceback.extract_tb(error.__traceback__)[-1]
                found["failed"][f"{type(error).__name__} at {Path(last.filename).name}:{last.lineno}"] += 1
                if len(list(out.glob(f"{_file_name(case)}-*"))) < KEPT:
                    (out / f"{_file_name(case)}-{number}.bin").write_bytes(
                        data if isinstance(data, bytes) else repr(data).encode()
                    )
            finally:
                signal.setitimer(signal.ITIMER_PROF, 0.0)
        sender.send(found)
    sender.close()


def _made(case: ReaderCase, seed: str) -> Any:
    """The input of a seed; where the fuzzer itself fails at it (a document that holds itself), that of the next one."""
    while True:
        try:
            return case.make(Random(seed))
        except (RecursionError, ValueError, MemoryError):
            seed += "+"


def _read_once(case: ReaderCase, folder: Path, seed: int) -> None:
    for number in range(20):
        try:
            case.read(folder, _made(case, f"{seed}/{case.name}/warm/{number}"))
        except Exception:
            continue


def _ring(*_: object) -> None:
    raise _TooSlow(f"more than {ALARM_S} s")


def _file_name(case: ReaderCase) -> str:
    return "".join(letter if letter.isalnum() else "-" for letter in case.name)


def _check(text: str) -> str:
    """Which check a message is of: its words without paths, quotations and numbers."""
    import re

    text = re.sub(r"\S*/\S*:?", "", text)
    text = re.sub(r"'[^']*'|`\$[^`]*`|\"[^\"]*\"|\[[\d., e+-]*\]", "…", text)
    text = re.sub(r", found .*", "", text)
    return " ".join(re.sub(r"[-+]?\d[\d.,e+-]*", "N", text).split())[:80]


def _table(results: list[dict[str, Any]]) -> list[str]:
    lines = [
        "| reader | inputs | accepted | refused | past the first parse | failures | refused most by |",
        "|" + " --- |" * 7,
    ]
    for result in results:
        refused, failed = result["refused"], sum(result["failed"].values())
        most = "; ".join(f"{check} ({number:,})" for check, number in list(refused.items())[:3]).replace("|", "/")
        lines.append(
            f"| {result['reader']} | {result['inputs']:,} | {result['accepted']:,} | {sum(refused.values()):,} | "
            f"{result['past']:.0%} | {failed} | {most} |"
        )
    total = sum(result["inputs"] for result in results)
    return [*lines, "", f"{total:,} inputs."]
