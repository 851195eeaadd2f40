"""Trains a floor head on the features of a frozen detector."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional

from edgemap.evaluation.floor import FloorScore
from edgemap.export.adopt import Tensor4
from edgemap.export.errors import ExportError
from edgemap.export.floor.cache import FULL, STRIDE, Pair, Records
from edgemap.export.floor.checkpoint import FloorCheckpoint, save_floor
from edgemap.export.floor.features import Features
from edgemap.export.floor.head import LABELS, STRIDES, FloorHead
from edgemap.export.floor.pictures import load, named
from edgemap.export.training import Schedule, Training, average_into
from edgemap.runtime.frames.reading import one_line
from edgemap.runtime.network.manifest import FloorSpec
from edgemap.runtime.network.preprocess import floor_mask

EDGE, EDGE_WEIGHT = 5, 2.0  # cells about the floor's edge, which count so much more
DICE = 0.3  # weight of the overlap beside the cross-entropy
DECAY = 0.99  # of the moving average of the weights, which is what is kept
NOISE = 0.05  # of the features' channels, each multiplied by 1 + so much


@dataclass(frozen=True)
class FloorSettings:
    """How to train. mix: shares of each source. minutes takes precedence over epochs."""

    batch: int = 16
    rate: float = 3e-3
    minutes: float | None = None
    epochs: int = 10
    mix: tuple[float, ...] = ()
    validate_minutes: float | None = None
    threads: int = 1
    seed: int = 0


class FloorTrainer(Training):
    """One run: cached views of pictures in, `best.pt`, the head with the highest mean IoU on `held_back`, out."""

    resume_format = "edgemap.floor.training/1"

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
        super().__init__(folder, settings.validate_minutes, settings.threads)
        torch.manual_seed(settings.seed)
        self._features, self._sources, self._held_back = features, sources, held_back
        self._credits = tuple(credits)
        self._settings, self._schedule = settings, Schedule(settings.minutes, settings.epochs)
        self._rng = np.random.default_rng(settings.seed)
        head = start or FloorHead(channels_of(features.taps), 0 if features.open else features.taps[2].height)
        self.head = head.to(memory_format=torch.channels_last)  # type: ignore[call-overload]
        self._average = {name: tensor.clone() for name, tensor in self.head.state_dict().items()}
        self._optimiser = torch.optim.AdamW(self.head.parameters(), settings.rate, weight_decay=1e-2)
        weights = settings.mix or tuple(float(len(source)) for source in sources)
        self._shares = np.array(weights) / sum(weights)

    def progress(self) -> float:
        """Share of the budget that is spent."""
        epoch = self.steps * self._settings.batch / sum(map(len, self._sources))
        return self._schedule.progress(self.trained_s, epoch)

    def take_steps(self) -> Iterator[None]:
        """Takes this many training steps, of one batch each."""
        while (progress := self.progress()) < 1.0:
            for group in self._optimiser.param_groups:
                group["lr"] = self._settings.rate * self._schedule.rate(progress)
            self.head.train()
            features, computed, truth, labelled = self._batch()
            loss, parts = floor_loss(self.head(*features, computed), truth, labelled)
            self._optimiser.zero_grad()
            loss.backward()
            self._optimiser.step()
            average_into(self._average, self.head, min(DECAY, self.steps / (self.steps + 10.0)))
            self.add(parts)
            yield

    def _batch(self) -> tuple[list[Tensor], Tensor, Tensor, Tensor]:
        """Features, which of their rows are computed, shares and what is known of them, mirrored or not, with noise on
        the features' channels."""
        chosen = []
        for source in self._rng.choice(len(self._sources), self._settings.batch, p=self._shares):
            records = self._sources[source]
            chosen.append(records[int(self._rng.integers(len(records)))])
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
        head = averaged(self.head, self._average)
        rows = {name: scored(head, self._features, pairs) for name, pairs in self._held_back.items()}
        row: dict[str, Any] = {"minutes": round(self.trained_s / 60.0, 2), "steps": self.steps, **self.means()}
        row |= {name: figures["iou"] for name, figures in rows.items()}
        row["iou"] = round(float(np.mean([figures["iou"] or 0.0 for figures in rows.values()])), 4)
        self.rows.append(row)
        print("  ".join(f"{name} {value}" for name, value in row.items()), flush=True)
        if row["iou"] >= max(one["iou"] for one in self.rows):
            measured = {"validation": rows, "settings": asdict(self._settings), "steps": self.steps}
            taps = self._features.taps
            names = (taps[0].name, taps[1].name, taps[2].name, taps[3].name)
            checkpoint = FloorCheckpoint(head, self._features.backbone, names, measured, self._credits)
            save_floor(checkpoint, self.folder / "best.pt")

    def best(self) -> dict[str, Any]:
        """The row with the highest mean IoU."""
        return max(self.rows, key=lambda row: row["iou"])

    def state(self) -> dict[str, Any]:
        """Weights, average, optimiser, random numbers."""
        return {
            "head": self.head.state_dict(),
            "average": self._average,
            "optimiser": self._optimiser.state_dict(),
            "random": self._rng.bit_generator.state,
        }

    def restore(self, state: dict[str, Any], path: Path) -> None:
        """Go on from `state`. Raises ExportError."""
        try:
            self.head.load_state_dict(state["head"])
            self._average = state["average"]
            self._optimiser.load_state_dict(state["optimiser"])
            self._rng.bit_generator.state = state["random"]
        except (KeyError, RuntimeError, ValueError, TypeError) as error:
            raise ExportError(f"{path}: belongs to another training ({one_line(error, 100)})") from None


def _stacked(maps: Sequence[NDArray[Any]], mirrored: NDArray[np.bool_]) -> Tensor:
    turned = [one[..., ::-1] if turn else one for one, turn in zip(maps, mirrored, strict=True)]
    return torch.from_numpy(np.stack(turned).astype(np.float32))


def channels_of(taps: Sequence[Tensor4]) -> tuple[int, int, int, int]:
    """Channels of the features that a head reads."""
    s4, s8, s16, s32 = (tap.channels for tap in taps)
    return s4, s8, s16, s32


def averaged(head: FloorHead, weights: dict[str, Tensor]) -> FloorHead:
    """A head of the same shape with these weights, ready to run."""
    copy = FloorHead(head.channels, head.rows, head.width, head.detail, len(head.deep))
    copy.load_state_dict(weights)
    return copy.eval()


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
    dice = (
        1.0
        - ((2.0 * both + 1.0) / (predicted.sum((1, 2, 3)) + (floor * labelled[:, None]).sum((1, 2, 3)) + 1.0)).mean()
    )
    loss = entropy[0] + 0.5 * entropy[1] + DICE * dice
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
