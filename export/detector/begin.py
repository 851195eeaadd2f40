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
from edgemap.runtime.bundle import sha256_file

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
        earlier = load_detector(Path(start))
        if earlier.names != names:
            raise ExportError(f"{start}: knows {len(earlier.names)} classes ({', '.join(earlier.names)}), not these")
        return DetectorCheckpoint(earlier.network, names, size, start, earlier.licence, earlier.sources)
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
