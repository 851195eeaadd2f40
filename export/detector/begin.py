"""What training begins with: YOLOX-Nano's weights, an earlier checkpoint, or nothing."""

from __future__ import annotations

from pathlib import Path

import torch

from edgemap.export.detector.checkpoint import DetectorCheckpoint, load_detector
from edgemap.export.detector.network import Nano
from edgemap.export.detector.start import load_yolox
from edgemap.export.errors import ExportError
from edgemap.export.obtain import obtain
from edgemap.export.sources import KNOWN
from edgemap.runtime.manifest import sha256_file
from edgemap.runtime.store import bundle_folder

SCRATCH, KNOWN_START = "none", "yolox-nano"
LICENCE = "Apache-2.0"
START_LICENCE = "Apache-2.0; fine-tuned from YOLOX-Nano, Copyright (c) 2021-2022 Megvii Inc., Apache-2.0"


def begin(start: str, names: tuple[str, ...], size: int, seed: int) -> DetectorCheckpoint:
    """The network to train. start: `yolox-nano` (fetched where needed), its .onnx file, a best.pt, or `none`.

    Raises ExportError or DownloadError.
    """
    torch.manual_seed(seed)
    if start == SCRATCH:
        return DetectorCheckpoint(Nano(len(names)), names, size, SCRATCH, LICENCE, ("trained from random weights",))
    if start.endswith(".pt"):
        begun = earlier(Path(start), names)
        return DetectorCheckpoint(begun.network, names, size, start, begun.licence, begun.sources)
    if start == KNOWN_START:
        path, sources = obtain(KNOWN[KNOWN_START])
    elif start.endswith(".onnx"):
        path, sources = Path(start), (f"{Path(start).name} sha256 {sha256_file(Path(start))}",)
    else:
        raise ExportError(
            f"--start {start}: expected {KNOWN_START}, {SCRATCH}, an .onnx file of YOLOX-Nano, or a .pt file"
        )
    network = Nano(len(names), norm=False)
    load_yolox(network, path, names)
    return DetectorCheckpoint(network, names, size, KNOWN_START, START_LICENCE, sources)


def kept_checkpoint(name: str) -> str:
    """A bundle's name or folder as the detector.pt that lies in it; anything else as it is."""
    file = bundle_folder(name) / "detector.pt"
    return str(file) if file.is_file() else name


def earlier(path: Path, names: tuple[str, ...]) -> DetectorCheckpoint:
    """A checkpoint to go on from. Raises ExportError where it is none, or knows other classes."""
    checkpoint = load_detector(path)
    if checkpoint.names != names:
        raise ExportError(f"{path}: knows {len(checkpoint.names)} classes ({', '.join(checkpoint.names)}), not these")
    return checkpoint
