"""The project's figures, and the pages made of them: `python -m edgemap.benchmarks.figures [NAME...] [--show]`.

Runs each command of figures.toml whose data is on this machine, writes its output to runs/figures/NAME.txt and its
figures into figures.json, and makes docs/figures.md, the charts beside it and README's table from that. Real data is in
$EDGEMAP_SHARED/data (default ../shared), rendered homes in $EDGEMAP_HOMES (default runs/homes). Commands whose data is
absent are printed. Rows of figures.json without a command of today carry the commit and date of their measurement.
"""

import json
import math
import os
import shlex
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from datetime import UTC, datetime
from html import escape
from itertools import count
from pathlib import Path
from string import Template
from typing import Annotated, Any

import tyro

Row = dict[str, Any]
HERE, OUT = Path(__file__).resolve().parent, Path("runs/figures")
JSON, BESIDE = HERE / "figures.json", "Beside others"
BEGIN, END = "<!-- made of benchmarks/figures.json -->", "<!-- end -->"


def commands() -> dict[str, Row]:
    """The tables of figures.toml, each command as words after `python -m`."""
    folders = {
        "SHARED": str(Path(os.environ.get("EDGEMAP_SHARED", "../shared")) / "data"),
        "HOMES": os.environ.get("EDGEMAP_HOMES", "runs/homes"),
    }
    found = tomllib.loads((HERE / "figures.toml").read_text())
    for one in found.values():
        one["words"] = [Template(word).substitute(folders) for word in shlex.split(one["command"])]
    return found


def values_at(document: Any, path: list[str], name: str = "") -> Iterator[tuple[str, float]]:
    """The numbers at a path into JSON, each with the name of what its last `*` stood for. Null is left out."""
    if not path:
        if document is not None:
            yield name, float(document)
        return
    step, rest = path[0], path[1:]
    if step != "*":
        yield from values_at(document[step], rest, name)
        return
    pairs = document.items() if isinstance(document, dict) else enumerate(document)
    for key, one in pairs:
        named = one.get("home", key) if isinstance(one, dict) else key
        yield from values_at(one, rest, Path(str(named)).name)


def measured(name: str, entry: Row, text: str) -> list[Row]:
    """The rows of a command's output."""
    document, rows = json.loads(text[text.index("{") :]), []
    commit = subprocess.run(["git", "rev-parse", "--short=8", "HEAD"], capture_output=True, text=True, check=False)
    for table, figure, path in entry["figures"]:
        found = dict(values_at(document, path.split("/")))
        numbers = list(found.values())
        row: Row = {"table": table, "figure": figure, "value": round(sum(numbers) / len(numbers), 4)}
        row |= {"low": min(numbers), "high": max(numbers)} if "*" in path else {"low": None, "high": None}
        row |= {"data": entry["data"], "had_a_say": entry["say"], "command": f"make figures FIGURES={name}"}
        row |= {"commit": commit.stdout.strip(), "date": f"{datetime.now(UTC):%Y-%m-%d}"}
        rows.append(row | ({"by": found} if "home" in entry["data"] and "*" in path else {}))
    return rows


def main(
    names: tyro.conf.Positional[tuple[str, ...]] = (), show: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
) -> None:
    """names: of commands, all by default. show: print the commands, run none, and make the pages again."""
    every, rows, failed = commands(), json.loads(JSON.read_text()), []
    if unknown := set(names) - set(every):
        sys.exit(f"figures: {', '.join(sorted(unknown))}: expected some of {', '.join(every)}")
    OUT.mkdir(parents=True, exist_ok=True)
    paths = ["tests", *filter(None, [os.environ.get("PYTHONPATH")])]  # `reliability` is in tests/
    env = os.environ | {"PYTHONPATH": os.pathsep.join(paths)}
    for name in names or every:
        words = every[name]["words"]
        inputs = [Path(word.partition(":")[2] or word) for word in words if "/" in word]
        absent = next((path for path in inputs if path != OUT and not path.exists()), None)
        print(f"{name}: python -m {shlex.join(words)}{f'  ({absent} is absent)' if absent else ''}", flush=True)
        if absent or show:
            continue
        run = subprocess.run([sys.executable, "-m", *words], env=env, capture_output=True, text=True, check=False)
        (OUT / f"{name}.txt").write_text(run.stdout + run.stderr)
        failed += [name] * (run.returncode != 0)
        if run.returncode == 0 and "figures" in every[name]:
            new = {(row["table"], row["figure"]): row for row in measured(name, every[name], run.stdout)}
            rows = [new.pop((row["table"], row["figure"]), row) for row in rows] + list(new.values())
            JSON.write_text(json.dumps(rows, indent=0, ensure_ascii=False) + "\n")
    for path, text in pages(rows).items():
        path.write_text(text)
    sys.exit(f"figures: failed, see {OUT}: {', '.join(failed)}" if failed else 0)


def pages(rows: list[Row]) -> dict[Path, str]:
    """The texts that are made of the figures, by file."""
    root, chosen = HERE.parent, {"README.md": README_ROWS, "docs/benchmark.md": LEADERBOARD}
    listed = [row for row in rows if row["table"] not in (BESIDE, "Benchmark")]
    parts = dict.fromkeys(row["table"] for row in listed)
    tables = {table: _table([row for row in rows if row["table"] == table], names=True) for table in parts}
    about: dict[str, list[str]] = {}
    for name, _, words in dict.fromkeys(row["data"].partition(", ") for row in listed):
        about.setdefault(name, []).append(words)
    tables["Data"] = "".join(f"- {name}: {'; '.join(words)}.\n" for name, words in about.items() if any(words))
    texts = {path: _table([row for row in rows if row["figure"] in names]) for path, names in chosen.items()}
    texts["docs/figures.md"] = "\n".join(f"## {table}\n\n{text}" for table, text in tables.items())
    return {root / path: _within((root / path).read_text(), text) for path, text in texts.items()} | {
        root / "docs" / "figures-homes.svg": _homes([row for row in rows if "by" in row]),
        root / "docs" / "figures-peers.svg": _peers([row for row in rows if row["table"] == BESIDE]),
    }


def _within(page: str, text: str) -> str:
    """A page with the part that is made of the figures made again."""
    before, _, rest = page.partition(BEGIN)
    return f"{before}{BEGIN}\n\n{text}\n{END}{rest.partition(END)[2]}"


README_ROWS = (
    "F1, with wheels", "F1, camera alone", "drift over 5 m, camera alone, frozen homes, %", "F1, pictures alone",
    "F1, with depth", "drift over 5 m, with depth, %", "F1, a legged robot's camera, pictures alone",
)  # fmt: skip
LEADERBOARD = (
    "F1, true poses", "F1, with wheels", "F1, camera alone", "F1, with wheels, tuning homes",
    "F1, camera alone, tuning homes", "baseline, true poses: F1", "baseline, with wheels: F1",
    "baseline, true poses, tuning homes: F1", "baseline, with wheels, tuning homes: F1",
)  # fmt: skip


def _table(rows: list[Row], names: bool = False) -> str:
    """A table of rows. names: data by its name alone, which is the text before the first comma."""
    lines = ["| figure | value | data | measured |", "| --- | --- | --- | --- |"]
    for row in rows:
        data = row["data"].partition(",")[0] if names else row["data"]
        say = ", tuned on" if row["had_a_say"] else ""
        when = " ".join(filter(None, (row["date"], row["commit"])))
        lines.append(f"| {row['figure'].strip()} | {_interval(row)} | {data}{say} | {when} |")
    return "\n".join(lines) + "\n"


def _interval(row: Row) -> str:
    low, high = (None if row[key] is None else f"{row[key]:.3g}" for key in ("low", "high"))
    if row["value"] is None:
        return f"{low} to {high}"
    ends = f"{low} to {high}" if low and high else f"lowest {low}" if low else f"highest {high}" if high else ""
    return f"{row['value']:.3g}" + (f" ({ends})" if ends else "")


STYLE = (
    "<style>text{font:13px system-ui,sans-serif;fill:#22272e}.m{fill:#5d6672}.g{stroke:#dfe3e8}.a{fill:#0072b2}"
    ".b{fill:#b45f06}@media(prefers-color-scheme:dark){text{fill:#e6e9ed}.m{fill:#9aa4b0}.g{stroke:#3a424c}"
    ".a{fill:#56b4e9}.b{fill:#ffc06b}}</style>"
)


def _svg(width: int, height: int, title: str, parts: list[str]) -> str:
    head = f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" role="img" aria-label="{title}">'
    return head + STYLE + "".join(parts) + "</svg>\n"


def _text(x: float, y: float, words: str, kind: str = "", anchor: str = "start") -> str:
    return f'<text x="{x:.0f}" y="{y:.0f}" class="{kind}" text-anchor="{anchor}">{escape(words)}</text>'


def _homes(rows: list[Row]) -> str:
    """A panel a figure, a bar a home."""
    parts, y = list[str](), 10.0
    for row in rows:
        parts.append(_text(0, y + 14, f"{row['figure']} ({row['data']}; {row['date']})"))
        top, y = max(row["by"].values()) or 1.0, y + 26
        for home, value in row["by"].items():
            parts.append(f'<rect class="a" x="70" y="{y}" width="{max(400 * value / top, 1):.1f}" height="13"/>')
            parts += [_text(62, y + 11, home, "m", "end"), _text(78 + 400 * value / top, y + 11, f"{value:.3g}", "m")]
            y += 18
        y += 16
    return _svg(560, round(y), "F1 and drift of each home", parts)


def _peers(rows: list[Row]) -> str:
    """A bar a comparison: by which factor edgemap is better, or worse."""
    parts = [_text(420, 14, "equal", "m", "middle")]
    parts.append(f'<line class="g" x1="420" x2="420" y1="20" y2="{20 + 44 * len(rows)}"/>')
    for y, row in zip(count(40.0, 44.0), rows, strict=False):
        gain = row["peer"] / row["value"] if row["lower_is_better"] else row["value"] / row["peer"]
        end = 420 + 80 * math.log2(gain)
        left, kind = min(end, 420.0), "a" if gain >= 1.0 else "b"
        parts.append(f'<rect class="{kind}" x="{left:.1f}" y="{y - 12}" width="{abs(end - 420):.1f}" height="16"/>')
        parts.append(_text(0, y - 4, row["figure"].strip()))
        parts.append(_text(0, y + 12, f"{row['value']:g}; {row['peer_name']}: {row['peer']:g}", "m"))
        parts.append(_text(max(end, 420) + 8, y, f"{gain:.2f}", "m"))
    return _svg(640, 40 + 44 * len(rows), "edgemap beside other programs", parts)


if __name__ == "__main__":
    tyro.cli(main, description=__doc__)
