"""Trains an odometry head on cached features: clips, loss, validation on whole drives, files to resume from."""

import copy
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import nn
from tqdm import tqdm

from edgemap.export.errors import ExportError
from edgemap.export.odometry.checkpoint import HeadCheckpoint, save_head
from edgemap.export.odometry.clips import ClipDraws, Shelf, make_batch
from edgemap.export.odometry.data import FeatureDrive
from edgemap.export.odometry.recipe import Recipe, validate
from edgemap.export.training import Panel, Schedule, Training, average_into, write_curves

CLIP_NORM = 1.0
AVERAGE_STEPS = 300
PANELS = (  # the first is the paper's figure 6
    Panel("loss", {"loss": "loss", "motion": "motion", "coarse": "coarse"}, from_zero=False),
    Panel(
        "validation drift, % of the way",
        {f"t{length}_percent": f"over {length} m" for length in (100, 40, 16, 8, 5, 2, 1)},
    ),
)


@dataclass(frozen=True)
class OdometrySettings:
    """How to train. minutes: the budget, or steps where that is None. patience: validations without a better one after
    which training stops early; None never. bfloat16: convolutions and correlations in half the width: 1.6 times as fast
    where the processor has AVX512-BF16; the gradient's direction stays (cosine 0.985)."""

    minutes: float | None = None
    steps: int = 2000
    batch: int = 6
    seed: int = 0
    validate_minutes: float = 5.0
    patience: int | None = None
    threads: int = 2
    bfloat16: bool = False
    device: str = "cpu"


class HeadTraining(Training):
    """Gives `best.pt`, `last.pt`, `curves.csv`, `curves.png` in a folder.

    start: the head as it starts. recipe: its loss and optimiser. train, validation: drives with features.
    """

    resume_format = "edgemap.head-run/1"

    def __init__(
        self,
        start: HeadCheckpoint,
        recipe: Recipe,
        train: Sequence[FeatureDrive],
        validation: Sequence[FeatureDrive],
        folder: Path,
        settings: OdometrySettings,
    ) -> None:
        super().__init__(folder, settings.validate_minutes, settings.threads, settings.device)
        self.start, self.recipe, self.settings = start, recipe, settings
        self.train, self.validation = train, validation
        self.head = start.head.to(self.device)
        self.draws, self.shelf = ClipDraws(recipe.clips, train), Shelf(train, self.device)
        self.average = {name: tensor.detach().clone() for name, tensor in self.head.state_dict().items()}
        self.optimizer = recipe.optimizer(self.head)
        self.schedule = Schedule(settings.minutes, settings.steps)

    def progress(self) -> float:
        """Share of the budget that is spent, by the clock or by steps."""
        return self.schedule.progress(self.trained_s, self.steps)

    def take_steps(self) -> Iterator[None]:
        """Clips, loss, gradient, one after the other; which clips follows from the seed and the step."""
        while self.progress() < 1.0:
            rng = np.random.default_rng((self.settings.seed, self.steps))
            clips = [self.draws.draw(rng) for _ in range(self.settings.batch)]
            factor = self.recipe.rate(self.progress(), self.steps)
            for group in self.optimizer.param_groups:
                group["lr"] = self.recipe.highest_rate * factor
            self.head.train()
            batch = self.recipe.vary(self.head, make_batch(clips, self.shelf, rng), rng)
            with torch.autocast(self.device.type, torch.bfloat16, enabled=self.settings.bfloat16):
                loss, parts = self.recipe.loss(self.head, batch, self.progress())
            self.add({name: part.detach().double() for name, part in {"loss": loss, **parts}.items()})
            self.optimizer.zero_grad(set_to_none=True)
            loss.backward()
            nn.utils.clip_grad_norm_(self.head.parameters(), CLIP_NORM)
            self.optimizer.step()
            average_into(self.average, self.head, 1.0 - 1.0 / min(AVERAGE_STEPS, 10 + self.steps / 4))
            yield

    def ended(self) -> bool:
        """Whether `patience` validations have passed without a better one."""
        since_best = len(self.rows) - 1 - self.rows.index(self.best())
        return self.settings.patience is not None and since_best >= self.settings.patience

    def best(self) -> dict[str, Any]:
        """The row of least drift."""
        return min(self.rows, key=lambda row: row["score"])

    def validate(self) -> None:
        """Validates the averaged weights on whole drives."""
        head = copy.deepcopy(self.head)
        head.load_state_dict(self.average)
        figures = validate(head.eval(), self.recipe.unroll, self.validation, self.recipe.window)
        measured = {name: value for name, value in figures.items() if isinstance(value, float)}
        row = {"minutes": round(self.trained_s / 60.0, 2), "steps": self.steps, **self.means(), **measured}
        self.rows.append(row)
        tqdm.write("  ".join(f"{key} {value:.4g}" for key, value in row.items()))
        if self.best() is row:
            save_head(self._checkpoint(head.cpu(), row, figures), self.folder / "best.pt")
        write_curves(self.rows, self.folder, ("steps", "steps of training"), PANELS)

    def state(self) -> dict[str, Any]:
        """State of head, average and optimiser, for a checkpoint."""
        return {
            "kind": self.start.kind,
            "backbone": self.start.backbone,
            "settings": asdict(self.settings),
            "head": self.head.state_dict(),
            "average": self.average,
            "optimizer": self.optimizer.state_dict(),
        }

    def restore(self, state: dict[str, Any], path: Path) -> None:
        """Raises ExportError for another kind of head or another backbone."""
        if (state["kind"], state["backbone"]) != (self.start.kind, self.start.backbone):
            raise ExportError(f"{path}: a {state['kind']} head for {state['backbone']}, not this run's")
        self.head.load_state_dict(state["head"])
        self.average = {name: tensor.to(self.device) for name, tensor in state["average"].items()}
        self.optimizer.load_state_dict(state["optimizer"])

    def _checkpoint(self, head: Any, row: dict[str, Any], figures: dict[str, Any]) -> HeadCheckpoint:
        measured = {
            "training": {"drives": len({drive.name for drive in self.train}), "settings": asdict(self.settings), **row},
            "validation": figures,
        }
        return HeadCheckpoint(
            head,
            self.start.backbone,
            self.start.feature,
            self.start.kind,
            True,
            (figures["rmse_forward_m"], figures["rmse_left_m"], figures["rmse_yaw_rad"]),
            self.recipe.envelope(self.train),
            measured,
            self.recipe.window,
        )
