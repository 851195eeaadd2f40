"""A detector's average precision on labelled pictures, and weight-space averages of two networks chosen by it.

Fine-tuning on rendered pictures degrades the network on photographs; interpolating back towards the start restores most
of that before much of the gain is lost (WiSE-FT; Wortsman et al. 2022).
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import torch

from edgemap.evaluation.detection import ScoredPicture, average_precision
from edgemap.export.detector.network import TorchNetwork
from edgemap.export.detector.store import Example
from edgemap.export.errors import ExportError
from edgemap.runtime.network.decode import Decoder
from edgemap.runtime.network.preprocess import Preprocessor

BATCH = 16
CONFIDENCE, NMS_IOU = 0.005, 0.6


@torch.no_grad()
def validate(network: TorchNetwork, examples: Sequence[Example]) -> dict[str, Any]:
    """`average_precision` of a network over examples, of the classes that their labels name."""
    detector, device = network.detector, next(network.parameters()).device
    prepare, decode = Preprocessor(detector.input), Decoder(detector, CONFIDENCE, NMS_IOU)
    scored = []
    for start in range(0, len(examples), BATCH):
        chunk = examples[start : start + BATCH]
        prepared = [(tensor.copy(), placement) for tensor, placement in (prepare(example.image) for example in chunk)]
        pictures = torch.from_numpy(np.concatenate([tensor for tensor, _ in prepared])).to(device)
        outputs = dict(zip(network.graph.outputs, (x.cpu().numpy() for x in network.graph(pictures)), strict=True))
        for row, (example, (_, placement)) in enumerate(zip(chunk, prepared, strict=True)):
            found = decode({name: value[row : row + 1] for name, value in outputs.items()}, placement)
            complete = example.complete[found.class_ids]
            scored.append(
                ScoredPicture(
                    example.boxes.astype(np.float64),
                    example.labels,
                    found.boxes[complete],
                    found.class_ids[complete],
                    found.scores[complete],
                    np.ones(len(example.boxes), np.bool_) if example.unasked is None else ~example.unasked,
                )
            )
    return average_precision(scored, network.names)


def validate_sets(
    network: TorchNetwork, validation: Mapping[str, Sequence[Example]]
) -> tuple[dict[str, dict[str, Any]], dict[str, float]]:
    """`validate` on each set of examples, by name; and for a table `ap` and `ap50`, means over the sets, and of several
    sets each one's `ap50_NAME`."""
    sets = {name: validate(network, examples) for name, examples in validation.items()}
    means = {key: round(sum(figures[key] for figures in sets.values()) / len(sets), 6) for key in ("ap", "ap50")}
    apart = {f"ap50_{name}": figures["ap50"] for name, figures in sets.items()} if len(sets) > 1 else {}
    return sets, means | apart


SHARES = (1.0, 0.95, 0.9, 0.85, 0.8, 0.7, 0.6)  # of the trained weights


def blend(start: TorchNetwork, tuned: TorchNetwork, share: float) -> TorchNetwork:
    """A network with `share` of the tuned weights and the rest of the start's. Raises ExportError where they differ."""
    ours, theirs = tuned.state_dict(), start.state_dict()
    if ours.keys() != theirs.keys() or any(ours[name].shape != theirs[name].shape for name in ours):
        raise ExportError("two networks of different layers do not blend")
    network = tuned.copy()
    network.load_state_dict({name: theirs[name] + share * (ours[name] - theirs[name]) for name in ours})
    return network


def choose_blend(
    start: TorchNetwork, tuned: TorchNetwork, validation: Mapping[str, Sequence[Example]], most_loss: float
) -> tuple[TorchNetwork, list[dict[str, Any]]]:
    """The blend nearest to the start that loses at most `most_loss` validation AP50, and the figures of each tried.

    AP50: the mean of the sets', as in training.
    """
    rows: list[dict[str, Any]] = []
    chosen = tuned
    for share in SHARES:
        network = blend(start, tuned, share)
        rows.append({"share": share} | validate_sets(network, validation)[1])
        if rows[-1]["ap50"] < rows[0]["ap50"] - most_loss:
            break
        chosen = network
    return chosen, rows
