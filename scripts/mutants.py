#!/usr/bin/env python
"""Mutation tests of the code that places objects: `python scripts/mutants.py --help`, or `make mutants`.

Packages map to top-level folders (edgemap.geometry is geometry/), which mutmut and cosmic-ray do not follow; so this
driver does what is needed here. One run of the tests under coverage records which test runs which line and how long it
takes. Then each mutant of a seeded sample is compiled in memory, in a process of its own, and the tests that run its
line are run, quickest first, until one fails. No file is changed. `.mutants/` keeps coverage and results; a stopped run
goes on.
"""

import argparse
import ast
import copy
import json
import multiprocessing
import os
import random
import resource
import sys
import time
from collections import Counter, defaultdict
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
STORE = ROOT / ".mutants"
# What a wrong line of would move objects unseen.
TARGETS = (
    "geometry", "runtime/frames", "runtime/network", "runtime/motion", "runtime/step", "evaluation/objects.py",
    "evaluation/trajectory.py", "evaluation/odometry.py",
)  # fmt: skip
# Those of these rooms; of the others, which drive files, pages and the command line, nothing is expected here.
TESTS = (
    "tests/geometry", "tests/evaluation", "tests/benchmarks/test_map_variants.py", "tests/runtime/calibration",
    *sorted(str(path.relative_to(ROOT)) for path in (ROOT / "tests/runtime").glob("test_*.py")),
)  # fmt: skip
CPU_S = 40  # of one mutant's tests; those that would take longer are left out, slowest first

BINARY = {ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult, ast.BitOr: ast.BitAnd,
          ast.BitAnd: ast.BitOr, ast.FloorDiv: ast.Div, ast.Mod: ast.FloorDiv}  # fmt: skip
COMPARE = {ast.Lt: ast.LtE, ast.LtE: ast.Lt, ast.Gt: ast.GtE, ast.GtE: ast.Gt, ast.Eq: ast.NotEq, ast.NotEq: ast.Eq,
           ast.Is: ast.IsNot, ast.IsNot: ast.Is, ast.In: ast.NotIn, ast.NotIn: ast.In}  # fmt: skip
NAMES = {"min": "max", "max": "min", "any": "all", "all": "any", "minimum": "maximum", "maximum": "minimum",
         "argmin": "argmax", "argmax": "argmin", "cos": "sin", "sin": "cos"}  # fmt: skip


@dataclass(frozen=True)
class Mutant:
    """One change of one node. index: of the node in a walk of the module. what: the change in words."""

    file: str
    line: int
    column: int
    last_line: int
    index: int
    choice: int
    what: str

    @property
    def name(self) -> str:
        """File, line, column and change."""
        return f"{self.file}:{self.line}:{self.column}: {self.what}"


def changes(node: ast.AST) -> list[tuple[str, ast.AST]]:
    """What a node may become, each with words for it."""
    found: list[tuple[str, ast.AST]] = []

    def other(words: str, **fields: object) -> None:
        new = copy.copy(node)
        for name, value in fields.items():
            setattr(new, name, value)
        found.append((words, new))

    if isinstance(node, ast.BinOp) and type(node.op) in BINARY:
        swap = BINARY[type(node.op)]
        other(f"{type(node.op).__name__} is {swap.__name__}", op=swap())
    elif isinstance(node, ast.BinOp) and isinstance(node.op, ast.MatMult):
        other("operands of @ swapped", left=node.right, right=node.left)
    elif isinstance(node, ast.AugAssign) and type(node.op) in BINARY:
        swap = BINARY[type(node.op)]
        other(f"{type(node.op).__name__}= is {swap.__name__}=", op=swap())
    elif isinstance(node, ast.Compare) and len(node.ops) == 1:
        swap = COMPARE[type(node.ops[0])]
        other(f"{type(node.ops[0]).__name__} is {swap.__name__}", ops=[swap()])
    elif isinstance(node, ast.BoolOp):
        swap = ast.Or if isinstance(node.op, ast.And) else ast.And
        other(f"{type(node.op).__name__} is {swap.__name__}", op=swap())
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, (ast.USub, ast.Not)):
        found.append((f"{type(node.op).__name__} dropped", node.operand))
    elif isinstance(node, ast.Constant) and isinstance(node.value, bool):
        other(f"{node.value} is {not node.value}", value=not node.value)
    elif isinstance(node, ast.Constant) and isinstance(node.value, int | float):
        value = node.value + 1 if isinstance(node.value, int) else node.value * 2.0 or 1.0
        other(f"{node.value!r} is {value!r}", value=value)
    elif isinstance(node, ast.Expr) and isinstance(node.value, ast.Call):
        found.append(("call dropped", ast.copy_location(ast.Pass(), node)))
    elif isinstance(node, ast.IfExp):
        other("branches swapped", body=node.orelse, orelse=node.body)
    elif isinstance(node, ast.Break):
        found.append(("break is continue", ast.copy_location(ast.Continue(), node)))
    elif isinstance(node, ast.Continue):
        found.append(("continue is break", ast.copy_location(ast.Break(), node)))
    elif isinstance(node, ast.Name) and node.id in NAMES:
        other(f"{node.id} is {NAMES[node.id]}", id=NAMES[node.id])
    elif isinstance(node, ast.Attribute) and node.attr in NAMES:
        other(f"{node.attr} is {NAMES[node.attr]}", attr=NAMES[node.attr])
    return found


class _Walk(ast.NodeTransformer):
    """Numbers the nodes that may change, and changes one. Annotations, messages, decorators and `__all__` stay."""

    def __init__(self, index: int = -1, choice: int = 0) -> None:
        self.count, self.index, self.choice = 0, index, choice
        self.sites: list[tuple[int, int, Any]] = []

    def visit(self, node: ast.AST) -> ast.AST:
        if isinstance(node, (ast.Raise, ast.JoinedStr, ast.Import, ast.ImportFrom)):
            return node
        if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.dump(node.test):
            return node
        here, self.count = self.count, self.count + 1
        if here == self.index:
            return changes(node)[self.choice][1]
        if self.index < 0:
            self.sites += [(here, number, node) for number in range(len(changes(node)))]
        for field, value in ast.iter_fields(node):
            if field in ("annotation", "returns", "decorator_list", "type_params"):
                continue
            if isinstance(value, ast.AST):
                setattr(node, field, self.visit(value))
            elif isinstance(value, list):
                value[:] = [self.visit(item) if isinstance(item, ast.AST) else item for item in value]
        return node


def mutants_of(file: str) -> list[Mutant]:
    """All mutants of a file."""
    walk = _Walk()
    walk.visit(ast.parse((ROOT / file).read_text()))
    found = []
    for index, choice, node in walk.sites:
        words = changes(node)[choice][0]
        found.append(Mutant(file, node.lineno, node.col_offset, node.end_lineno, index, choice, words))
    return found


def mutated(mutant: Mutant) -> ast.Module:
    """The module with the change in it."""
    tree = ast.parse((ROOT / mutant.file).read_text())
    _Walk(mutant.index, mutant.choice).visit(tree)
    return ast.fix_missing_locations(tree)


def files() -> Iterator[str]:
    """The files whose lines are changed."""
    for target in TARGETS:
        path = ROOT / target
        for file in sorted(path.rglob("*.py")) if path.is_dir() else [path]:
            if file.is_file() and file.name != "__init__.py":
                yield str(file.relative_to(ROOT))


class _Recorder:
    """A pytest plugin: which test runs which line, and how much processor time each passing test takes."""

    def __init__(self) -> None:
        import coverage

        self.coverage = coverage.Coverage(
            data_file=str(STORE / "coverage"), include=[str(ROOT / file) for file in files()]
        )
        self.seconds: dict[str, float] = {}
        self.failed: set[str] = set()
        self.begun = 0.0

    def pytest_runtest_logstart(self, nodeid: str) -> None:
        """What runs from here on is of this test."""
        self.coverage.switch_context(nodeid)
        self.begun = time.process_time()

    def pytest_runtest_logfinish(self, nodeid: str) -> None:
        """Keep the test's time."""
        self.seconds[nodeid] = time.process_time() - self.begun

    def pytest_runtest_logreport(self, report: Any) -> None:
        """One that fails or is skipped proves nothing."""
        if not report.passed:
            self.failed.add(report.nodeid)


def record_coverage() -> None:
    """Run the tests once and keep, by file and line, which of those that passed run it. Raises RuntimeError."""
    import pytest

    recorder = _Recorder()
    recorder.coverage.start()
    code = int(
        pytest.main(["-q", "-p", "no:cacheprovider", "-m", "not slow", "--timeout=0", *TESTS], plugins=[recorder])
    )
    recorder.coverage.stop()
    if code > 1:  # 1: some tests fail, and prove nothing
        raise RuntimeError(f"pytest ended with {code}: no coverage was recorded")
    data, lines = recorder.coverage.get_data(), {}
    for file in files():
        contexts = data.contexts_by_lineno(str(ROOT / file))
        lines[file] = {line: [c for c in found if c not in recorder.failed] for line, found in contexts.items()}
    (STORE / "lines.json").write_text(json.dumps({"lines": lines, "seconds": recorder.seconds}))


class Chooser:
    """Which tests to run for a mutant: those that run its lines, the quickest of each function first."""

    def __init__(self) -> None:
        found = json.loads((STORE / "lines.json").read_text())
        self.lines, self.seconds = found["lines"], found["seconds"]

    def tests(self, mutant: Mutant) -> list[str]:
        """Names of tests, as many as the time of one mutant allows."""
        lines = self.lines.get(mutant.file, {})
        own = {t for line in range(mutant.line, mutant.last_line + 1) for t in lines.get(str(line), []) if "::" in t}
        if not own and str(mutant.line) in lines:  # runs when the module is read: a default, a constant
            own = {test for tests in lines.values() for test in tests if "::" in test}
        spent, chosen = 0.0, []
        for test in sorted(own, key=lambda test: (self.seconds.get(test, 0.0), test)):
            spent += self.seconds.get(test, 0.0)
            if spent > CPU_S:
                break
            chosen.append(test)
        return chosen


class _Finder:
    """Imports one module from a changed tree, all others as usual."""

    def __init__(self, file: str, tree: ast.Module) -> None:
        self.name = "edgemap." + file.removesuffix(".py").replace("/", ".")
        self.path, self.tree = ROOT / file, tree

    def find_spec(self, name: str, path: object = None, target: object = None) -> Any:  # noqa: ARG002
        """Of the changed module only."""
        from importlib.util import spec_from_loader

        loader: Any = self
        return spec_from_loader(name, loader, origin=str(self.path)) if name == self.name else None

    def create_module(self, spec: Any) -> None:
        """As usual."""

    def exec_module(self, module: Any) -> None:
        """Run the changed tree."""
        module.__file__ = str(self.path)
        exec(compile(self.tree, str(self.path), "exec"), module.__dict__)


def _child(mutant: Mutant | None, tests: list[str], limit_s: int) -> None:
    """Exit status 0: all tests pass, the mutant lives. None changes nothing. limit_s: of processor time."""
    import pytest

    quiet = os.open(os.devnull, os.O_WRONLY)
    os.dup2(quiet, 1)
    os.dup2(quiet, 2)
    resource.setrlimit(resource.RLIMIT_CPU, (limit_s, limit_s))
    if mutant is not None:
        sys.meta_path.insert(0, _Finder(mutant.file, mutated(mutant)))  # type: ignore[arg-type]
    os._exit(int(pytest.main(["-x", "-q", "-p", "no:cacheprovider", "--hypothesis-seed=0", "--timeout=900", *tests])))


def outcome(mutant: Mutant, chooser: Chooser) -> str:
    """killed, survived, or untested where no test runs its line. Raises RuntimeError where pytest itself fails."""
    tests = chooser.tests(mutant)
    if not tests:
        return "untested"
    code = _exit_code(mutant, tests, chooser)
    if code in (3, 4, 5):  # of pytest: internal error, usage error, no tests
        raise RuntimeError(f"{mutant.name}: pytest ended with {code} for {tests[:3]}")
    return "survived" if code == 0 else "killed"


def _exit_code(mutant: Mutant | None, tests: list[str], chooser: Chooser) -> int:
    """Of pytest; negative where the mutant ran a minute longer than twice what its tests take, which kills it."""
    limit_s = 60 + int(2 * sum(chooser.seconds.get(test, 0.0) for test in tests))
    process = multiprocessing.get_context("fork").Process(target=_child, args=(mutant, tests, limit_s))
    process.start()
    process.join()
    return process.exitcode or 0


def _work(share: list[Mutant], check: bool) -> Iterator[dict[str, object]]:
    """Outcomes, one by one. check: first that the tests pass without any mutant. Raises RuntimeError where not."""
    chooser = Chooser()
    tests = next((tests for mutant in share if (tests := chooser.tests(mutant))), [])
    if check and tests and (code := _exit_code(None, tests, chooser)):
        raise RuntimeError(f"tests fail without any mutant (pytest {code}): record again with --again")
    for mutant in share:
        begun = time.monotonic()
        yield {"mutant": mutant.name, "outcome": outcome(mutant, chooser), "s": round(time.monotonic() - begun, 1)}


def report(results: list[dict], asked: int) -> str:
    """What came of the sample, the survivors by name."""
    counts = Counter(row["outcome"] for row in results)
    by_file: dict[str, Counter[str]] = defaultdict(Counter)
    for row in results:
        by_file[row["mutant"].split(":")[0]][row["outcome"]] += 1
    lines = [f"{row['outcome']}: {row['mutant']}" for row in results if row["outcome"] != "killed"]
    lines += [f"{file}: {own['killed']} of {own.total()} killed" for file, own in sorted(by_file.items())]
    share = counts["killed"] / max(len(results), 1)
    return "\n".join(
        [*lines, f"{counts['killed']} of {len(results)} mutants killed ({share:.0%}); {asked} in the sample"]
    )


def main() -> None:
    """Sample, run what the time allows, report."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sample", type=int, default=300, metavar="N")
    parser.add_argument("--seed", type=int, default=1, metavar="N", help="of the sample")
    parser.add_argument("--minutes", type=float, default=60.0, metavar="M", help="then stop; a later call goes on")
    parser.add_argument("--only", default="", metavar="TEXT", help="mutants whose name holds this, all of them")
    parser.add_argument("--again", action="store_true", help="record coverage and run the mutants again")
    options = parser.parse_args()
    os.chdir(ROOT)
    os.environ |= {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    STORE.mkdir(exist_ok=True)
    if options.again or not (STORE / "lines.json").is_file():
        process = multiprocessing.get_context("spawn").Process(target=record_coverage)
        process.start()
        process.join()
        if process.exitcode:
            sys.exit("mutants: no coverage was recorded")
    every = [mutant for file in files() for mutant in mutants_of(file)]
    if options.only:
        sample = [mutant for mutant in every if options.only in mutant.name]
    else:
        sample = random.Random(options.seed).sample(every, min(options.sample, len(every)))
    journal = STORE / "results.jsonl"
    if options.again:
        journal.unlink(missing_ok=True)
    known = (
        {row["mutant"]: row for row in map(json.loads, journal.read_text().splitlines())} if journal.exists() else {}
    )
    left = [mutant for mutant in sample if mutant.name not in known]
    for name in (
        "numpy",
        "scipy.spatial",
        "scipy.optimize",
        "scipy.sparse.linalg",
        "cv2",
        "hypothesis",
        "msgspec",
        "pytest",
    ):
        __import__(name)  # once, before the processes part
    print(
        f"{len(every)} mutants in {len(list(files()))} files, {len(sample)} in the sample, {len(left)} to run",
        flush=True,
    )
    end = time.monotonic() + 60.0 * options.minutes
    for row in _work(left, check=not known):
        known[row["mutant"]] = row
        with journal.open("a") as file:
            file.write(json.dumps(row) + "\n")
        if row["outcome"] != "killed":
            print(f"{row['outcome']}: {row['mutant']}", flush=True)
        if time.monotonic() > end:
            break
    print(report([known[mutant.name] for mutant in sample if mutant.name in known], len(sample)))


if __name__ == "__main__":
    main()
