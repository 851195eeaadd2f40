"""Trains an odometry head on cached features: clips, loss, validation on whole drives, files to resume from."""

from __future__ import annotations

import copy
import math
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import nn
from tqdm import tqdm

from edgemap.export.detector.schedule import Schedule
from edgemap.export.errors import ExportError
from edgemap.export.odometry.checkpoint import HeadCheckpoint, save_head
from edgemap.export.odometry.clips import make_batch
from edgemap.export.odometry.curves import write_curves
from edgemap.export.odometry.data import FeatureDrive
from edgemap.export.odometry.recipe import Recipe
from edgemap.export.odometry.validate import validate
from edgemap.export.torch_files import read_torch, save_whole

RESUME_FORMAT = "edgemap.head-run/1"
SAVE_EVERY_S = 120.0
CLIP_NORM = 1.0
AVERAGE_STEPS = 300


@dataclass(frozen=True)
class Settings:
    """How to train. minutes: the budget, or steps where that is None. patience: validations without a better one after
    which training stops early; None never."""

    minutes: float | None = None
    steps: int = 2000
    batch: int = 6
    seed: int = 0
    validate_minutes: float = 5.0
    patience: int | None = None
    threads: int = 2


class HeadTrainer:
    """One run in a folder: `best.pt`, `last.pt`, `curves.csv`, `curves.png`.

    start: the head as it starts. recipe: its loss and optimiser. train, validation: drives with features.
    """

    def __init__(
        self,
        start: HeadCheckpoint,
        recipe: Recipe,
        train: Sequence[FeatureDrive],
        validation: Sequence[FeatureDrive],
        folder: Path,
        settings: Settings,
    ) -> None:
        torch.set_num_threads(settings.threads)
        self.start, self.recipe, self.settings, self.folder = start, recipe, settings, folder
        self.train, self.validation = train, validation
        self.head = start.head
        self.average = {name: tensor.detach().clone() for name, tensor in self.head.state_dict().items()}
        self.optimizer = recipe.optimizer(self.head)
        self.schedule = Schedule(settings.minutes, settings.steps)
        self.steps, self.trained_s, self.best, self.since_best = 0, 0.0, math.inf, 0
        self.rows: list[dict[str, Any]] = []
        self._sums: dict[str, float] = {}
        self._count = 0
        folder.mkdir(parents=True, exist_ok=True)

    def resume(self) -> None:
        """Go on from `last.pt`. Raises ExportError where it belongs to another run."""
        path = self.folder / "last.pt"
        state = read_torch(path)
        if state.get("format") != RESUME_FORMAT:
            raise ExportError(f"{path}: format {state.get('format')!r}, expected {RESUME_FORMAT!r}")
        if (state["kind"], state["backbone"]) != (self.start.kind, self.start.backbone):
            raise ExportError(f"{path}: a {state['kind']} head for {state['backbone']}, not this run's")
        self.head.load_state_dict(state["head"])
        self.average = state["average"]
        self.optimizer.load_state_dict(state["optimizer"])
        self.steps, self.trained_s, self.best = state["steps"], state["trained_s"], state["best"]
        self.since_best, self.rows = state["since_best"], state["rows"]

    def run(self) -> dict[str, Any]:
        """Train until the budget is spent; gives the best validation's figures. An interrupt saves `last.pt` first."""
        began, before_s = time.perf_counter(), self.trained_s
        validated = saved = before_s
        bar = tqdm(total=100, unit="%", bar_format="{l_bar}{bar}| {elapsed} {postfix}", mininterval=2.0)
        try:
            while self.progress() < 1.0:
                self._step()
                self.trained_s = before_s + time.perf_counter() - began
                self._show(bar)
                if self.trained_s - validated >= 60.0 * self.settings.validate_minutes:
                    validated = self.trained_s
                    self._validate()
                    if self.settings.patience is not None and self.since_best >= self.settings.patience:
                        break
                if self.trained_s - saved >= SAVE_EVERY_S:
                    saved = self.trained_s
                    self.save()
            if not self.rows or self.rows[-1]["steps"] != self.steps:
                self._validate()
        finally:
            bar.close()
            self.save()
        return min(self.rows, key=lambda row: row["score"])

    def progress(self) -> float:
        """Share of the budget that is spent."""
        return self.schedule.progress(self.trained_s, self.steps)

    def save(self) -> None:
        """Write `last.pt`."""
        state = {
            "format": RESUME_FORMAT,
            "kind": self.start.kind,
            "backbone": self.start.backbone,
            "settings": asdict(self.settings),
            "head": self.head.state_dict(),
            "average": self.average,
            "optimizer": self.optimizer.state_dict(),
            "steps": self.steps,
            "trained_s": self.trained_s,
            "best": self.best,
            "since_best": self.since_best,
            "rows": self.rows,
        }
        save_whole(state, self.folder / "last.pt")

    def _step(self) -> None:
        rng = np.random.default_rng((self.settings.seed, self.steps))
        clips = [self.recipe.clips.draw(self.train, rng) for _ in range(self.settings.batch)]
        factor = self.recipe.rate(self.progress(), self.steps)
        for group in self.optimizer.param_groups:
            group["lr"] = self.recipe.highest_rate * factor
        self.head.train()
        loss, parts = self.recipe.loss(self.head, make_batch(clips), self.progress())
        if not math.isfinite(loss.item()):
            raise ExportError(f"training diverged at step {self.steps}: the loss is not finite; a lower --rate may do")
        self.optimizer.zero_grad(set_to_none=True)
        loss.backward()
        nn.utils.clip_grad_norm_(self.head.parameters(), CLIP_NORM)
        self.optimizer.step()
        self.steps += 1
        decay = 1.0 - 1.0 / min(AVERAGE_STEPS, 10 + self.steps / 4)
        for name, tensor in self.head.state_dict().items():
            self.average[name].lerp_(tensor, 1.0 - decay)
        for name, value in (("loss", float(loss.detach())), *parts.items()):
            self._sums[name] = self._sums.get(name, 0.0) + value
        self._count += 1

    def _show(self, bar: Any) -> None:
        bar.n = round(100 * self.progress(), 1)
        mean = self._sums["loss"] / max(1, self._count)
        bar.set_postfix_str(f"step {self.steps} loss {mean:.3f} best {self.best:.3g}", refresh=False)
        bar.update(0)

    def averaged(self) -> nn.Module:
        """The head with its averaged weights."""
        head = copy.deepcopy(self.head)
        head.load_state_dict(self.average)
        return head.eval()

    def _validate(self) -> None:
        head = self.averaged()
        figures = validate(head, self.recipe.unroll, self.validation)
        row = {
            "minutes": round(self.trained_s / 60.0, 2),
            "steps": self.steps,
            **{name: round(value / max(1, self._count), 5) for name, value in self._sums.items()},
            **{name: value for name, value in figures.items() if isinstance(value, float)},
        }
        self._sums, self._count = {}, 0
        self.rows.append(row)
        tqdm.write("  ".join(f"{key} {value:.4g}" for key, value in row.items()))
        if row["score"] < self.best:
            self.best, self.since_best = row["score"], 0
            save_head(self._checkpoint(head, row, figures), self.folder / "best.pt")
        else:
            self.since_best += 1
        write_curves(self.rows, self.folder)

    def _checkpoint(self, head: Any, row: dict[str, Any], figures: dict[str, Any]) -> HeadCheckpoint:
        measured = {
            "training": {"drives": len(self.train), "settings": asdict(self.settings), **row},
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
        )
