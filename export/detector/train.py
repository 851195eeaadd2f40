"""Trains a bundle's detector: batches, loss, moving average, validation, and checkpoints to resume from."""

import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any

import torch

from edgemap.export.detector.boxes import Rows
from edgemap.export.detector.loader import Batches
from edgemap.export.detector.loss import Assignment, Targets, detection_loss, distance_loss
from edgemap.export.detector.network import TorchNetwork
from edgemap.export.detector.store import Example
from edgemap.export.detector.validate import validate_sets
from edgemap.export.settings import DetectorSettings
from edgemap.export.training import Training, rate_at

CLIP_NORM = 20.0
NO_MOSAIC = 0.85  # of the budget after which pictures stay single
PARTS = ("total", "scores", "box", "bins", "kept")
PANELS = {
    "loss": {"scores": "scores", "box": "box (1 - GIoU)", "bins": "sides' bins", "kept": "distance kept"},
    "validation": {"ap50": "AP50", "ap": "AP 0.50:0.95"},
}


class Trainer(Training[TorchNetwork, DetectorSettings]):
    """Gives `best.pt`, `last.pt`, `curves.csv`, `curves.png` in a folder.

    start: the network to train. reference: the reference network to stay close to without labels; the start by default.
    train: examples as `load_examples` gives. validation: sets of them by name; the network with the highest mean of
    their AP50 is the best. Under `torchrun` every process takes its share of each epoch.
    """

    resume_format = "edgemap.detector-run/2"
    score = "ap50"
    panels = PANELS

    def __init__(
        self,
        start: TorchNetwork,
        train: Sequence[Example],
        validation: Mapping[str, Sequence[Example]],
        folder: Path,
        settings: DetectorSettings,
        reference: TorchNetwork | None = None,
    ) -> None:
        super().__init__(folder, settings, start.copy(), partial(torch.optim.AdamW, weight_decay=0.0), settings.epochs)
        self.train, self.validation = train, validation
        self.reference = (reference or start).copy().to(self.device).requires_grad_(False)
        self.forward = self.ranks.wrap(self.network)
        self.batches = Batches(
            train, settings.size or start.side, settings.batch, settings.seed, settings.mosaic, settings.mix,
            self.ranks.rank, self.ranks.count, self._workers(),
        )  # fmt: skip
        self.epoch, self.index = 0, 0

    def spent(self) -> float:
        """Epochs done."""
        return self.epoch + self.index / len(self.batches)

    def take_steps(self) -> Iterator[None]:
        """Epoch by epoch; without --validate-minutes validated after each. Mosaics stop before the end."""
        while self.progress() < 1.0:
            mosaic = self.batches.mosaic = self.settings.mosaic if self.progress() < NO_MOSAIC else 0.0
            for images, targets in self.batches.epoch(self.epoch, self.index):
                self.train_batch(images, targets)
                self.index += 1
                yield
                if self.progress() >= 1.0 or (mosaic > 0.0 and self.progress() >= NO_MOSAIC):
                    break
            if self.index >= len(self.batches):
                self.epoch, self.index = self.epoch + 1, 0
                if self.settings.validate_minutes is None:
                    self.validate()

    def state(self) -> dict[str, Any]:
        """Where in which epoch, and the random numbers."""
        return {"epoch": self.epoch, "index": self.index, "random": torch.get_rng_state()}

    def restore(self, state: dict[str, Any], path: Path) -> None:  # noqa: ARG002
        """Go on at the next batch."""
        self.epoch, self.index = state["epoch"], state["index"]
        torch.set_rng_state(state["random"])

    def train_batch(self, images: torch.Tensor, targets: Targets) -> None:
        """One step of the optimiser on a batch."""
        rate = self.settings.rate * rate_at(self.progress())
        images, targets = images.to(self.device, non_blocking=True), targets.to(self.device)
        with self._narrow():
            rows = self.network.read(self.forward(images), images)
        losses, found = detection_loss(rows, targets, self.ranks.mean, 1.0 / self.ranks.count)
        losses["kept"] = self._distance(images, rows, targets, found)
        losses["total"] = losses["total"] + self.settings.keep * losses["kept"]
        self.learn(losses["total"], {part: losses[part] for part in PARTS}, rate, CLIP_NORM)

    def _distance(self, images: torch.Tensor, rows: Rows, targets: Targets, found: Assignment) -> torch.Tensor:
        """From the reference network's predictions where there are no labels, per cell with a box."""
        if not self.settings.keep:
            return torch.zeros((), device=self.device)
        with torch.no_grad(), self._narrow():
            reference = self.reference.read(self.reference(images), images)
        distance, seen = distance_loss(rows, reference, targets.kept[:, None] & ~found.positive[..., None])
        return distance / self.ranks.mean(seen + found.positive.sum()).clamp(min=1.0 / self.ranks.count)

    def _narrow(self) -> torch.autocast:
        return torch.autocast(self.device.type, torch.bfloat16, enabled=self.settings.bfloat16)

    def _workers(self) -> int:
        """Processes that make pictures: two beside a processor's network; a GPU wants all that there are."""
        return 2 if self.device.type == "cpu" else max(2, (os.cpu_count() or 2) // self.ranks.count - 1)

    def validate(self) -> None:
        """Validates the averaged weights on every validation set, in the first process."""
        means = self.means(4)
        row = self.ranks.broadcast(self._validated(means) if self.ranks.first else None)
        if not self.ranks.first:
            self.rows.append(row)

    def _validated(self, means: dict[str, float]) -> dict[str, Any]:
        network, pictures = self.averaged(), self.steps * self.settings.batch * self.ranks.count
        sets, figures = validate_sets(network, self.validation)
        if self.enter({"epoch": round(self.spent(), 2), "pictures": pictures, **means, **figures}):
            training = {"pictures": len(self.train), "settings": asdict(self.settings), **self.rows[-1]}
            network.save(self.folder / "best.pt", {"training": training, "validation": sets})
        return self.rows[-1]
