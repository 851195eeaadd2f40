"""Cost of a bundle's floor head, from onnxruntime's profile of its operators."""

import json
import tempfile
from pathlib import Path

import numpy as np
import onnxruntime as ort

from edgemap.runtime.network.bundle import Bundle
from edgemap.runtime.network.engines import PROVIDERS, session_options
from edgemap.runtime.network.network import Compute

ROUNDS = 40


def floor_head_ms(bundle: Bundle) -> float | None:
    """Time of the head's operators on one thread in onnxruntime, ms: the sum of each one's median, which other programs
    hardly change; None without a floor head. It is part of the stage `backbone`."""
    floor = bundle.manifest.detector.floor
    if floor is None:
        return None
    with tempfile.TemporaryDirectory() as folder:
        options = session_options(Compute(), bundle.detector.input.height)
        options.enable_profiling, options.profile_file_prefix = True, str(Path(folder) / "run")
        path = str(bundle.folder / bundle.manifest.detector.file)
        session = ort.InferenceSession(path, options, providers=PROVIDERS)
        tensors = {name: np.zeros(shape, np.float32) for name, shape in bundle.backbone.inputs.items()}
        for _ in range(ROUNDS):
            session.run(None, tensors)
        events = json.loads(Path(session.end_profiling()).read_text())
    laps_us: dict[str, list[float]] = {}
    for event in events:
        name = event["name"]
        if event.get("cat") == "Node" and name.startswith(floor.name) and name.endswith("_kernel_time"):
            laps_us.setdefault(name, []).append(event["dur"])
    return round(sum(float(np.median(laps)) for laps in laps_us.values()) / 1e3, 3)
