"""What this machine computes with."""

import platform
from pathlib import Path

CPUINFO = Path("/proc/cpuinfo")


def multiplies_int8(cpuinfo: Path = CPUINFO) -> bool:
    """Whether products of 8-bit numbers are added up exactly: on x86 with VNNI only, elsewhere always.

    Without it pairs of products are added in 16 bits, which overflow.
    """
    if platform.machine().lower() not in ("x86_64", "amd64"):
        return True
    return bool({"avx512_vnni", "avx_vnni"} & _flags(cpuinfo))


def computes_bf16(cpuinfo: Path = CPUINFO) -> bool:
    """Whether an x86 processor multiplies numbers of 16 bits with float32's exponent."""
    return bool({"avx512_bf16", "amx_bf16"} & _flags(cpuinfo))


def _flags(cpuinfo: Path) -> set[str]:
    if not cpuinfo.is_file():
        return set()
    return set(next((line for line in cpuinfo.read_text().splitlines() if line.startswith("flags")), "").split())


def processor_name() -> str:
    """The processor's name as the system reports it, else its architecture."""
    if CPUINFO.is_file():
        for line in CPUINFO.read_text().splitlines():
            if line.startswith("model name"):
                return line.split(":", 1)[1].strip()
    return platform.processor() or platform.machine()
