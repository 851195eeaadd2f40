"""What this machine computes with."""

from __future__ import annotations

import platform
from pathlib import Path


def multiplies_int8(cpuinfo: Path = Path("/proc/cpuinfo")) -> bool:
    """Whether products of 8-bit numbers are added up exactly: on x86 with VNNI only, elsewhere always.

    Without it pairs of products are added in 16 bits, which overflow.
    """
    if platform.machine().lower() not in ("x86_64", "amd64"):
        return True
    if not cpuinfo.is_file():
        return False
    flags = next((line for line in cpuinfo.read_text().splitlines() if line.startswith("flags")), "")
    return bool({"avx512_vnni", "avx_vnni"} & set(flags.split()))


def processor_name() -> str:
    """The processor's name as the system tells it, else its architecture."""
    cpuinfo = Path("/proc/cpuinfo")
    if cpuinfo.is_file():
        for line in cpuinfo.read_text().splitlines():
            if line.startswith("model name"):
                return line.split(":", 1)[1].strip()
    return platform.processor() or platform.machine()
