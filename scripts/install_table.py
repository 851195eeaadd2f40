#!/usr/bin/env python
"""Which installs resolve to built packages alone, as a Markdown table: `python scripts/install_table.py`.

For each processor, Python and extra, `uv pip compile` resolves what pyproject.toml asks for, with its environment
markers, for Linux with glibc 2.35 (Ubuntu 22.04, JetPack 6; Raspberry Pi OS 12 has 2.36). Nothing is installed and
nothing is built. The index is uv's (UV_INDEX_URL and its like say another one).
"""

import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]
GLIBC = "manylinux_2_35"
PROCESSORS = ("x86_64", "aarch64")
PYTHONS = ("3.11", "3.12", "3.13", "3.14")
# The base without its optional RealSense part, extras of robots, and that part by itself.
INSTALLS = ("base", "view", "record", "foxglove", "mqtt", "ros2", "fleet", "mcp", "openvino", "realsense")


def resolved(install: str, processor: str, python: str) -> str:
    """How many packages an install needs, or which one has no built package there."""
    command = [sys.executable, "-m", "uv", "pip", "compile", "--quiet", "--no-header", "--no-annotate"]
    command += ["--only-binary", ":all:", "--python-version", python, "--python-platform", f"{processor}-{GLIBC}"]
    if install != "base":
        command += ["--extra", install]
    result = subprocess.run([*command, str(ROOT / "pyproject.toml")], capture_output=True, text=True, check=False)
    if result.returncode == 0:
        packages = [line.partition("==")[0] for line in result.stdout.splitlines() if line.strip()]
        return f"{len(packages)}"
    words = " ".join(result.stderr.split())
    lacking = re.search(r"Because (?:only )?(?:all versions of )?([A-Za-z0-9_.-]+)", words)
    return f"no: {lacking[1]}" if lacking else f"no: {words[:60]}"


def main() -> None:
    """Print the table."""
    columns = [(processor, python) for processor in PROCESSORS for python in PYTHONS]
    print("| install | " + " | ".join(f"{processor}, {python}" for processor, python in columns) + " |")
    print("| --- |" + " --- |" * len(columns))
    for install in INSTALLS:
        cells = [resolved(install, *column) for column in columns]
        print(f"| `{install}` | " + " | ".join(cells) + " |", flush=True)


if __name__ == "__main__":
    main()
