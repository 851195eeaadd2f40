"""Trains `edgemap-nano`: batches, loss, moving average, validation, and files that a resume goes on from."""

from __future__ import annotations

import copy
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import torch
from torch import nn
from tqdm import tqdm

from edgemap.export.curves import Panel, write_curves
from edgemap.export.detector.checkpoint import RESUME_FORMAT, DetectorCheckpoint, save_detector
from edgemap.export.detector.loader import Batches
from edgemap.export.detector.loss import detection_loss
from edgemap.export.detector.network import Head, Nano
from edgemap.export.detector.store import Example
from edgemap.export.detector.validate import validate
from edgemap.export.errors import ExportError
from edgemap.export.schedule import Schedule
from edgemap.export.training import Training, average_into

AVERAGE_STEPS = 600  # the moving average looks back about so far, less at the start
CLIP_NORM = 20.0
NO_MOSAIC = 0.85  # of the budget after which pictures stay single
PARTS = ("total", "box", "objectness", "classes", "kept")
PANELS = (
    Panel("loss per positive cell", {"box": "box (1 - GIoU)", "objectness": "objectness", "classes": "classes"}),
    Panel("validation", {"ap50": "AP50", "ap": "AP 0.50:0.95"}, top=1.0),
)


@dataclass(frozen=True)
class Settings:
    """How to train. rate: highest learning rate of the heads' last layers; the trunk learns at `trunk_rate` of it.

    keep: weight of staying near the start's features on the same pictures: what the start knows of real pictures is
    not in rendered ones. mix: share of pictures of each source; empty for every picture once an epoch. frozen: parts of
    the network that keep their start values. validate_minutes: between two validations; None: after every epoch.
    bfloat16: convolutions in half the width, weights and losses in full: 1.7 times as fast on a processor with
    AVX512-BF16.
    """

    size: int = 416
    batch: int = 16
    seed: int = 0
    minutes: float | None = None
    epochs: int = 10
    rate: float = 1e-3
    trunk_rate: float = 0.5
    mosaic: float = 0.5
    keep: float = 0.0
    mix: tuple[float, ...] = ()
    frozen: tuple[str, ...] = ()
    validate_minutes: float | None = None
    threads: int = 2
    bfloat16: bool = False


class Trainer(Training):
    """One run in a folder: `best.pt`, `last.pt`, `curves.csv`, `curves.png`.

    start: the network that features are kept near, with its origin; train: examples as `load_examples` gives.
    validation: sets of them by name; the checkpoint with the highest mean of their AP50 is the best. begun: the network
    to go on from, where that is not the start. Under `torchrun` every process takes its share of each epoch.
    """

    resume_format = RESUME_FORMAT

    def __init__(
        self,
        start: DetectorCheckpoint,
        train: Sequence[Example],
        validation: Mapping[str, Sequence[Example]],
        folder: Path,
        settings: Settings,
        begun: Nano | None = None,
    ) -> None:
        super().__init__(folder, settings.validate_minutes, settings.threads)
        self.start, self.settings = start, settings
        self.train, self.validation = train, validation
        for network in (start.network, begun):
            if network is not None:
                network.to(memory_format=torch.channels_last)  # type: ignore[call-overload]
        self.network = copy.deepcopy(begun or start.network)
        for part in settings.frozen:
            self.network.get_submodule(part).requires_grad_(False)
        self.learning = [parameter for parameter in self.network.parameters() if parameter.requires_grad]
        self.forward = self.ranks.wrap(Forward(self.network))
        self.teacher = start.network.eval() if settings.keep > 0.0 else None
        self.average = {name: tensor.detach().clone() for name, tensor in self.network.state_dict().items()}
        self.optimizer = torch.optim.AdamW(_groups(self.network, settings), weight_decay=0.0)
        self.schedule = Schedule(settings.minutes, settings.epochs)
        self.epoch, self.index = 0, 0

    def progress(self) -> float:
        """By the clock or by epochs."""
        return self.schedule.progress(self.trained_s, self.epoch + self.index / self._batches())

    def take_steps(self) -> Iterator[None]:
        """Epoch by epoch; without --validate-minutes validated after each. Mosaics stop before the end."""
        while self.progress() < 1.0:
            mosaic = self.settings.mosaic if self.progress() < NO_MOSAIC else 0.0
            loader = Batches(
                self.train, self.settings.size, self.settings.batch, self.settings.seed, mosaic, self.settings.mix,
                self.ranks.rank, self.ranks.count,
            )  # fmt: skip
            for images, targets in loader.epoch(self.epoch, self.index):
                self._step(images, targets)
                self.index += 1
                yield
                if self.progress() >= 1.0 or (mosaic > 0.0 and self.progress() >= NO_MOSAIC):
                    break
            if self.index >= self._batches():
                self.epoch, self.index = self.epoch + 1, 0
                if self.settings.validate_minutes is None:
                    self.validate()

    def best(self) -> dict[str, Any]:
        """The row of the highest AP50."""
        return max(self.rows, key=lambda row: row["ap50"])

    def state(self) -> dict[str, Any]:
        """Network, average, optimiser, where in which epoch."""
        return {
            "names": list(self.start.names),
            "start": self.start.start,
            "settings": asdict(self.settings),
            "network": self.network.state_dict(),
            "average": self.average,
            "optimizer": self.optimizer.state_dict(),
            "epoch": self.epoch,
            "index": self.index,
            "random": torch.get_rng_state(),
        }

    def restore(self, state: dict[str, Any], path: Path) -> None:
        """Raises ExportError where it started from something else, or for other classes."""
        if tuple(state["names"]) != self.start.names or state["start"] != self.start.start:
            raise ExportError(
                f"{path}: started from {state['start']} for {len(state['names'])} classes, not this run's"
            )
        self.network.load_state_dict(state["network"])
        self.average = state["average"]
        self.optimizer.load_state_dict(state["optimizer"])
        self.epoch, self.index = state["epoch"], state["index"]
        torch.set_rng_state(state["random"])

    def _batches(self) -> int:
        return max(1, len(self.train) // (self.settings.batch * self.ranks.count))

    def _step(self, images: torch.Tensor, targets: Any) -> None:
        factor = self.schedule.rate(self.progress())
        for group in self.optimizer.param_groups:
            group["lr"] = group["highest"] * factor
        self.network.train()
        with torch.autocast("cpu", torch.bfloat16, enabled=self.settings.bfloat16):
            x4, maps, heads = self.forward(images)
            kept = None if self.teacher is None else self._drift(x4, images, maps)
        losses = detection_loss([head.float() for head in heads], targets, self.ranks.mean)
        if kept is not None:
            losses["kept"] = kept
            losses["total"] = losses["total"] + self.settings.keep * kept
        self.add({part: losses[part].item() if part in losses else 0.0 for part in PARTS})
        self.optimizer.zero_grad(set_to_none=True)
        losses["total"].backward()
        nn.utils.clip_grad_norm_(self.learning, CLIP_NORM)
        self.optimizer.step()
        average_into(self.average, self.network, 1.0 - 1.0 / min(AVERAGE_STEPS, 10 + self.steps / 4))

    def _drift(self, x4: torch.Tensor, images: torch.Tensor, maps: Sequence[torch.Tensor]) -> torch.Tensor:
        """Relative squared distance of the trunk's maps from those of the start, summed over the strides."""
        assert self.teacher is not None
        with torch.no_grad():
            theirs = self.teacher.late(
                x4 if {"stem", "down4"} <= set(self.settings.frozen) else self.teacher.early(images)
            )
        distances = [
            (ours.float() - known.float()).square().mean() / self.ranks.mean(known.float().square().mean())
            for ours, known in zip(maps, theirs, strict=True)
        ]
        return torch.stack(distances).sum()

    def averaged(self) -> Nano:
        """The network with its averaged weights."""
        network = copy.deepcopy(self.network)
        network.load_state_dict(self.average)
        return network.eval()

    def validate(self) -> None:
        """With the averaged weights, on every validation set, in the first process."""
        means = self.means(4)
        row = self.ranks.told(self._validated(means) if self.ranks.first else None)
        if not self.ranks.first:
            self.rows.append(row)

    def _validated(self, means: dict[str, float]) -> dict[str, Any]:
        network = self.averaged()
        names, size = self.start.names, self.settings.size
        sets = {name: validate(network, examples, names, size) for name, examples in self.validation.items()}
        apart = {f"ap50_{name}": figures["ap50"] for name, figures in sets.items()} if len(sets) > 1 else {}
        row = {
            "minutes": round(self.trained_s / 60.0, 2),
            "epoch": round(self.epoch + self.index / self._batches(), 2),
            "pictures": self.steps * self.settings.batch * self.ranks.count,
            **means,
            "ap": round(sum(figures["ap"] for figures in sets.values()) / len(sets), 6),
            "ap50": round(sum(figures["ap50"] for figures in sets.values()) / len(sets), 6),
            **apart,
        }
        self.rows.append(row)
        tqdm.write("  ".join(f"{key} {value}" for key, value in row.items()))
        if self.best() is row:
            measured = {
                "training": {"pictures": len(self.train), "settings": asdict(self.settings), **row},
                "validation": sets if apart else next(iter(sets.values())),
            }
            save_detector(
                DetectorCheckpoint(
                    network,
                    self.start.names,
                    self.settings.size,
                    self.start.start,
                    self.start.licence,
                    self.start.sources,
                    measured,
                ),
                self.folder / "best.pt",
            )
        write_curves(self.rows, self.folder, ("minutes", "minutes of training"), PANELS)
        return row


class Forward(nn.Module):
    """One pass, as `DistributedDataParallel` wants it: the first layers' map, the trunk's maps, raw heads."""

    def __init__(self, network: Nano) -> None:
        super().__init__()
        self.network = network

    def forward(self, images: torch.Tensor) -> tuple[torch.Tensor, tuple[torch.Tensor, ...], tuple[torch.Tensor, ...]]:
        """Pictures (B, 3, H, W)."""
        x4 = self.network.early(images)
        maps = self.network.late(x4)
        return x4, maps, self.network.look(maps)


def _groups(network: Nano, settings: Settings) -> list[dict[str, Any]]:
    """Two groups: the trunk with the heads' branches, and the heads' last layers."""
    final = [
        parameter
        for head in network.heads
        if isinstance(head, Head)
        for layer in (head.classes, head.boxes, head.objectness)
        for parameter in layer.parameters()
    ]
    last = {id(parameter) for parameter in final}
    trunk = [p for p in network.parameters() if p.requires_grad and id(p) not in last]
    rate = settings.rate
    return [
        {"params": trunk, "lr": rate, "highest": rate * settings.trunk_rate},
        {"params": final, "lr": rate, "highest": rate},
    ]
