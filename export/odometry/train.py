"""Trains an odometry head on cached features: clips, loss, validation on complete drives, resuming."""

from collections.abc import Iterator, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import torch

from edgemap.export.errors import ExportError
from edgemap.export.odometry.checkpoint import HeadCheckpoint, save_head
from edgemap.export.odometry.clips import ClipDraws, Shelf, make_batch
from edgemap.export.odometry.data import FeatureDrive
from edgemap.export.odometry.recipe import Recipe, validate
from edgemap.export.settings import OdometrySettings
from edgemap.export.training import Panel, Training

CLIP_NORM = 1.0
PANELS = (  # the first is the paper's figure 6
    Panel("loss", {"loss": "loss", "motion": "motion", "coarse": "coarse"}, from_zero=False),
    Panel(
        "validation drift, % of the way",
        {f"t{length}_percent": f"over {length} m" for length in (100, 40, 16, 8, 5, 2, 1)},
    ),
)


class HeadTraining(Training[Any, OdometrySettings]):
    """One training of a head; writes `best.pt`, `last.pt`, `curves.csv` and `curves.png` to its folder.

    start: the initial head. recipe: its loss and optimiser. train, validation: drives with features.
    """

    resume_format = "edgemap.head-run/2"
    highest = False  # the least drift is the best
    average_steps = 300
    panels = PANELS

    def __init__(
        self,
        start: HeadCheckpoint,
        recipe: Recipe,
        train: Sequence[FeatureDrive],
        validation: Sequence[FeatureDrive],
        folder: Path,
        settings: OdometrySettings,
    ) -> None:
        super().__init__(folder, settings, start.head, recipe.optimizer, settings.steps)
        self.start, self.recipe = start, recipe
        self.train, self.validation = train, validation
        self.draws, self.shelf = ClipDraws(recipe.clips, train), Shelf(train, self.device)

    def take_steps(self) -> Iterator[None]:
        """Train step by step: draw clips, compute the loss, descend. Seed and step number determine the clips."""
        while self.progress() < 1.0:
            rng = np.random.default_rng((self.settings.seed, self.steps))
            clips = [self.draws.draw(rng) for _ in range(self.settings.batch)]
            rate = self.recipe.highest_rate * self.recipe.rate(self.progress(), self.steps)
            batch = self.recipe.vary(self.network, make_batch(clips, self.shelf, rng), rng)
            with torch.autocast(self.device.type, torch.bfloat16, enabled=self.settings.bfloat16):
                loss, parts = self.recipe.loss(self.network, batch, self.progress())
            found = {name: part.double() for name, part in {"loss": loss.detach(), **parts}.items()}
            self.learn(loss, found, rate, CLIP_NORM)
            yield

    def ended(self) -> bool:
        """Whether `patience` validations have passed without a better one."""
        since_best = len(self.rows) - 1 - self.rows.index(self.best())
        return self.settings.patience is not None and since_best >= self.settings.patience

    def validate(self) -> None:
        """Validate the averaged weights on complete drives."""
        head = self.averaged()
        figures = validate(head, self.recipe.unroll, self.validation, self.recipe.window)
        measured = {name: value for name, value in figures.items() if isinstance(value, float)}
        if self.enter({"steps": self.steps, **self.means(), **measured}):
            save_head(self._checkpoint(head.cpu(), figures), self.folder / "best.pt")

    def state(self) -> dict[str, Any]:
        """Kind of the head and its backbone."""
        return {"kind": self.start.kind, "backbone": self.start.backbone}

    def restore(self, state: dict[str, Any], path: Path) -> None:
        """Raises ExportError for another kind of head or another backbone."""
        if (state["kind"], state["backbone"]) != (self.start.kind, self.start.backbone):
            raise ExportError(f"{path}: a {state['kind']} head for {state['backbone']}, not this run's")

    def _checkpoint(self, head: Any, figures: dict[str, Any]) -> HeadCheckpoint:
        drives = len({drive.name for drive in self.train})
        training = {"drives": drives, "settings": asdict(self.settings), **self.rows[-1]}
        return HeadCheckpoint(
            head,
            self.start.backbone,
            self.start.feature,
            self.start.kind,
            True,
            (figures["rmse_forward_m"], figures["rmse_left_m"], figures["rmse_yaw_rad"]),
            self.recipe.envelope(self.train),
            {"training": training, "validation": figures},
            self.recipe.window,
        )
