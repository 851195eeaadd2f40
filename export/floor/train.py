"""Trains a floor head on the features of a frozen detector."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional

from edgemap.evaluation.floor import FloorScore
from edgemap.export.floor.cache import FULL, STRIDE, Records
from edgemap.export.floor.checkpoint import FloorCheckpoint, save_floor
from edgemap.export.floor.features import Features
from edgemap.export.floor.head import LABELS, STRIDES, FloorHead
from edgemap.export.floor.pictures import Pair, load, named
from edgemap.export.settings import FloorSettings
from edgemap.export.training import Training, rate_at
from edgemap.runtime.network.manifest import FloorSpec
from edgemap.runtime.network.preprocess import floor_mask

EDGE, EDGE_WEIGHT = 5, 2.0  # cells about the floor's edge, which count so much more
DICE = 0.3  # weight of the overlap beside the cross-entropy
DECAY = 0.99  # of the moving average of the weights, which is what is kept
NOISE = 0.05  # of the features' channels, each multiplied by 1 + so much


class FloorTrainer(Training[FloorHead, FloorSettings]):
    """Cached views of pictures in, `best.pt`, the head with the highest mean IoU on `held_back`, out."""

    resume_format = "edgemap.floor.training/2"
    score = "iou"

    def __init__(
        self,
        features: Features,
        sources: Sequence[Records],
        held_back: Mapping[str, Sequence[Pair]],
        folder: Path,
        settings: FloorSettings,
        start: FloorHead | None = None,
        credits: Sequence[str] = (),
    ) -> None:
        torch.manual_seed(settings.seed)
        channels = tuple(tap.channels for tap in features.taps)
        head = start or FloorHead(channels, 0 if features.open else features.taps[2].height)
        head = head.to(memory_format=torch.channels_last)  # type: ignore[call-overload]
        super().__init__(folder, settings, head, partial(torch.optim.AdamW, weight_decay=1e-2), settings.epochs)
        self._features, self._sources, self._held_back = features, sources, held_back
        self._credits = tuple(credits)
        self._rng = np.random.default_rng(settings.seed)
        weights = settings.mix or tuple(float(len(source)) for source in sources)
        self._shares = np.array(weights) / sum(weights)

    def spent(self) -> float:
        """Epochs done."""
        return self.steps * self.settings.batch / sum(map(len, self._sources))

    def decay(self) -> float:
        """A shorter look back than the other trainings'."""
        return min(DECAY, (self.steps - 1.0) / (self.steps + 9.0))

    def take_steps(self) -> Iterator[None]:
        """Takes this many training steps, of one batch each."""
        while (progress := self.progress()) < 1.0:
            features, computed, truth, labelled = self._batch()
            loss, parts = floor_loss(self.network(*features, computed), truth, labelled)
            self.learn(loss, parts, self.settings.rate * rate_at(progress))
            yield

    def _batch(self) -> tuple[list[Tensor], Tensor, Tensor, Tensor]:
        """Features, which of their rows are computed, shares and what is known of them, mirrored or not, with noise on
        the features' channels."""
        drawn = [self._sources[at] for at in self._rng.choice(len(self._sources), self.settings.batch, p=self._shares)]
        chosen = [records[int(self._rng.integers(len(records)))] for records in drawn]
        mirrored = self._rng.random(len(chosen)) < 0.5
        maps = [_stacked([kept[f"s{level}"] for kept in chosen], mirrored) for level in range(len(STRIDES))]
        noisy = [one.mul_(1.0 + NOISE * torch.randn(*one.shape[:2], 1, 1)) for one in maps]
        truth, labelled = (
            _stacked([kept[part] for kept in chosen], mirrored).div_(FULL) for part in ("truth", "known")
        )
        computed = torch.from_numpy(np.stack([kept["computed"] for kept in chosen]).astype(np.float32))
        return [one.contiguous(memory_format=torch.channels_last) for one in noisy], computed, truth, labelled

    def validate(self) -> None:
        """Add a row, and write `best.pt` where it is the best one."""
        head = self.averaged().to(memory_format=torch.contiguous_format)  # type: ignore[call-overload]
        rows = {name: scored(head, self._features, pairs) for name, pairs in self._held_back.items()}
        row: dict[str, Any] = {"steps": self.steps, **self.means()} | {name: one["iou"] for name, one in rows.items()}
        row["iou"] = round(float(np.mean([figures["iou"] or 0.0 for figures in rows.values()])), 4)
        if self.enter(row):
            measured = {"validation": rows, "settings": asdict(self.settings), "steps": self.steps}
            names = tuple(tap.name for tap in self._features.taps)
            checkpoint = FloorCheckpoint(head, self._features.backbone, names, measured, self._credits)
            save_floor(checkpoint, self.folder / "best.pt")

    def state(self) -> dict[str, Any]:
        """State of the random generator."""
        return {"random": self._rng.bit_generator.state}

    def restore(self, state: dict[str, Any], path: Path) -> None:  # noqa: ARG002
        """Go on with the next batch."""
        self._rng.bit_generator.state = state["random"]


def _stacked(maps: Sequence[NDArray[Any]], mirrored: NDArray[np.bool_]) -> Tensor:
    turned = [one[..., ::-1] if turn else one for one, turn in zip(maps, mirrored, strict=True)]
    return torch.from_numpy(np.stack(turned).astype(np.float32))


def floor_loss(logits: Tensor, truth: Tensor, labelled: Tensor) -> tuple[Tensor, dict[str, Tensor]]:
    """Cross-entropy of both labels, the floor's edge counting more, and one minus the floor's overlap (Dice).

    logits, truth: (B, 2, H, W); labelled: (B, H, W), the share of each cell that is labelled.
    """
    floor, padding = truth[:, :1], EDGE // 2
    edge = functional.max_pool2d(floor, EDGE, 1, padding) + functional.max_pool2d(-floor, EDGE, 1, padding)
    weight = labelled[:, None] * (1.0 + EDGE_WEIGHT * edge)
    entropy = functional.binary_cross_entropy_with_logits(logits, truth, reduction="none")
    entropy = (entropy * weight).sum((0, 2, 3)) / weight.sum().clamp(min=1.0)
    predicted = logits[:, :1].sigmoid() * labelled[:, None]
    both = (predicted * floor).sum((1, 2, 3))
    either = predicted.sum((1, 2, 3)) + (floor * labelled[:, None]).sum((1, 2, 3))
    dice = ((2.0 * both + 1.0) / (either + 1.0)).mean()
    loss = entropy[0] + 0.5 * entropy[1] + DICE * (1.0 - dice)
    return loss, {"loss": loss.detach(), "floor": entropy[0].detach(), "wall": entropy[1].detach()}


def scored(head: FloorHead, features: Features, pairs: Sequence[Pair]) -> dict[str, Any]:
    """The figures of `eval floor` on labelled pictures."""
    score = FloorScore()
    for pair in pairs:
        image, shares = load(pair)
        levels, placement, computed = features(image)
        with torch.no_grad():
            mask = head(*map(torch.from_numpy, [*levels, computed])).sigmoid().numpy()
        shape = (1, len(LABELS), *mask.shape[2:])
        spec = FloorSpec(name="floor", shape=shape, stride=STRIDE, labels=LABELS)
        seen = floor_mask({"floor": mask}, placement, spec)
        assert seen is not None
        score.add(seen, named(shares))
    return score.row()
