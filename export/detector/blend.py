"""Between the start and what training made of it: weight-space averages (WiSE-FT; Wortsman et al. 2022).

Fine-tuning on rendered pictures forgets photographs; on the straight line back to the start most of that returns
before much of what was learnt is lost.
"""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from edgemap.export.detector.checkpoint import DetectorCheckpoint
from edgemap.export.detector.network import Nano
from edgemap.export.detector.store import Example
from edgemap.export.detector.validate import validate
from edgemap.export.errors import ExportError

SHARES = (1.0, 0.95, 0.9, 0.85, 0.8, 0.7, 0.6)  # of the trained weights


def blend(start: Nano, tuned: Nano, share: float) -> Nano:
    """A network with `share` of the tuned weights and the rest of the start's. Raises ExportError where they differ."""
    ours, theirs = tuned.state_dict(), start.state_dict()
    if ours.keys() != theirs.keys() or any(ours[name].shape != theirs[name].shape for name in ours):
        raise ExportError("two networks of different layers do not blend")
    network = copy.deepcopy(tuned)
    network.load_state_dict({name: theirs[name] + share * (ours[name] - theirs[name]) for name in ours})
    return network.eval()


def choose_blend(
    start: Nano, tuned: DetectorCheckpoint, validation: Mapping[str, Sequence[Example]], most_loss: float
) -> tuple[DetectorCheckpoint, list[dict[str, Any]]]:
    """The blend nearest to the start that loses at most `most_loss` validation AP50, and the figures of each tried.

    AP50: the mean of the sets', as in training.
    """
    rows: list[dict[str, Any]] = []
    chosen = tuned
    for share in SHARES:
        network = blend(start, tuned.network, share)
        sets = {name: validate(network, examples, tuned.names, tuned.size) for name, examples in validation.items()}
        mean = {key: sum(figures[key] for figures in sets.values()) / len(sets) for key in ("ap", "ap50")}
        apart = {f"ap50_{name}": figures["ap50"] for name, figures in sets.items()} if len(sets) > 1 else {}
        rows.append({"share": share, **mean, **apart})
        if mean["ap50"] < rows[0]["ap50"] - most_loss:
            break
        measured = tuned.measured | {"blend": list(rows), "validation": sets if apart else next(iter(sets.values()))}
        chosen = replace(tuned, network=network, measured=measured)
    return chosen, rows
