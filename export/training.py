"""Parts common to all trainings: budget, validations that select `best.pt`, `last.pt` for resuming, curves."""

import copy
import csv
import math
import os
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, ClassVar, Generic, TypeVar

import torch
from torch import Tensor, distributed, nn
from torch.nn.parallel import DistributedDataParallel
from torch.optim.swa_utils import get_ema_multi_avg_fn
from tqdm import tqdm

from edgemap.export.errors import ExportError
from edgemap.export.settings import Settings
from edgemap.export.torch_files import read_torch, save_whole
from edgemap.runtime.frames.disk import make_folder

SAVE_EVERY_S = 120.0
LOOK_EVERY = 20  # steps of a GPU between two reads of its losses, as each read waits for it
WARM_UP = 0.03  # of the budget
LAST_RATE = 0.03  # of the highest
# Pairs of axes by their title; columns of the table to their names in the legend. One without values is left out.
Panels = Mapping[str, Mapping[str, str]]
N = TypeVar("N", bound=nn.Module)
S = TypeVar("S", bound=Settings)


class Ranks:
    """The processes of one training. rank: this one's number; count: how many; alone unless `torchrun` started them.

    device: what it computes on; each process of `cuda` has a GPU of its own. Raises ExportError where there is none.
    """

    def __init__(self, device: str = "cpu") -> None:
        self.rank, self.count = int(os.environ.get("RANK", "0")), int(os.environ.get("WORLD_SIZE", "1"))
        if device == "cuda":
            if not torch.cuda.is_available():
                raise ExportError("--device cuda: torch finds no GPU here")
            torch.cuda.set_device(int(os.environ.get("LOCAL_RANK", "0")))
        self.device = torch.device(device)
        if self.count > 1 and not distributed.is_initialized():
            distributed.init_process_group("gloo" if device == "cpu" else "nccl")

    @property
    def first(self) -> bool:
        """Whether this process writes files and prints."""
        return self.rank == 0

    def wrap(self, module: nn.Module) -> nn.Module:
        """The module whose gradients are means over all processes."""
        return DistributedDataParallel(module) if self.count > 1 else module

    def mean(self, value: Tensor) -> Tensor:
        """The mean of a tensor without gradient over all processes."""
        if self.count == 1:
            return value
        total = value.detach().clone()
        distributed.all_reduce(total)
        return total / self.count

    def broadcast(self, value: Any) -> Any:
        """The first process's value, on all processes."""
        if self.count == 1:
            return value
        box = [value]
        distributed.broadcast_object_list(box)
        return box[0]


class Training(ABC, Generic[N, S]):
    """One training in a folder: it trains `network`, and validates and saves the moving average of its weights. rows:
    the figures of each validation. sums: losses since the last validation. budget: steps or epochs, where no minutes
    are set."""

    resume_format: str
    score = "score"  # column of the figure by which the best row is chosen
    highest = True  # whether the best one is the highest
    average_steps = 600  # time constant of the moving average, shorter at the start
    panels: ClassVar[Panels] = {}  # of the curves

    def __init__(
        self,
        folder: Path,
        settings: S,
        network: N,
        optimizer: Callable[[list[nn.Parameter]], torch.optim.Optimizer],
        budget: int,
    ) -> None:
        torch.set_num_threads(settings.threads)
        self.ranks = Ranks(settings.device)
        self.device = self.ranks.device
        self.folder, self.settings, self.budget = folder, settings, budget
        self.network = network.to(self.device).train()
        self.learning = list(network.parameters())
        self.average = {name: tensor.detach().clone() for name, tensor in network.state_dict().items()}
        self.optimizer = optimizer(self.learning)
        self.steps, self.trained_s = 0, 0.0
        self.rows: list[dict[str, Any]] = []
        self.sums: dict[str, float | Tensor] = {}
        self.count = 0
        make_folder(folder)

    @abstractmethod
    def take_steps(self) -> Iterator[None]:
        """Train: yields after each step, and ends when the budget is spent."""

    @abstractmethod
    def validate(self) -> None:
        """Add a row, and write `best.pt` where it is the best one."""

    def spent(self) -> float:
        """Steps or epochs done."""
        return self.steps

    def state(self) -> dict[str, Any]:
        """Further state that a resume needs."""
        return {}

    def restore(self, state: dict[str, Any], path: Path) -> None:
        """Restores the values of `state`. Raises ExportError where they belong to another run."""

    def progress(self) -> float:
        """Share of the budget that is spent, 0..1."""
        if self.settings.minutes is not None:
            return min(1.0, self.trained_s / (60.0 * self.settings.minutes))
        return min(1.0, self.spent() / self.budget) if self.budget else 1.0

    def decay(self) -> float:
        """Share of the moving average that a step keeps."""
        return 1.0 - 1.0 / min(self.average_steps, 10 + self.steps / 4)

    def best(self) -> dict[str, Any]:
        """The best row."""
        return (max if self.highest else min)(self.rows, key=lambda row: row[self.score])

    def learn(self, loss: Tensor, parts: Mapping[str, Tensor], rate: float, clip_norm: float = math.inf) -> None:
        """One step of the optimiser and of the moving average. parts: of the loss, for the curves; on a GPU they are
        read only at intervals. Raises ExportError where they are not finite."""
        for name, part in parts.items():
            self.sums[name] = self.sums.get(name, 0.0) + part.detach()
        self.count += 1
        self.steps += 1
        if self._reads_losses() and not all(map(math.isfinite, self.sums.values())):
            raise ExportError(f"training diverged at step {self.steps}: the loss is not finite; a lower --rate may do")
        for group in self.optimizer.param_groups:
            group["lr"] = rate
        self.optimizer.zero_grad(set_to_none=True)
        loss.backward()
        if clip_norm < math.inf:
            nn.utils.clip_grad_norm_(self.learning, clip_norm)
        self.optimizer.step()
        average_into(self.average, self.network, self.decay())

    def averaged(self) -> N:
        """A copy of the network with its averaged weights."""
        network = copy.deepcopy(self.network)
        network.load_state_dict(self.average)
        return network.eval()

    def enter(self, row: dict[str, Any]) -> bool:
        """Adds a validation's row, prints it and draws the curves. Returns whether it is the best one."""
        self.rows.append({"minutes": round(self.trained_s / 60.0, 2), **row})
        tqdm.write("  ".join(f"{key} {value:.6g}" for key, value in self.rows[-1].items() if value is not None))
        if self.panels:
            write_curves(self.rows, self.folder, self.panels)
        return self.best() is self.rows[-1]

    def run(self) -> dict[str, Any]:
        """Train until the budget is spent. Returns the figures of the best validation. An interrupt saves `last.pt`
        first."""
        began, before_s = time.perf_counter(), self.trained_s
        validated = saved = before_s
        minutes = self.settings.validate_minutes
        every_s = math.inf if minutes is None else 60.0 * minutes
        bar = tqdm(
            total=100,
            disable=not self.ranks.first,
            unit="%",
            bar_format="{l_bar}{bar}| {elapsed} {postfix}",
            mininterval=2.0,
        )
        try:
            for _ in self.take_steps():
                self.trained_s = self.ranks.broadcast(before_s + time.perf_counter() - began)
                self._show(bar)
                if self.trained_s - validated >= every_s:
                    validated = self.trained_s
                    self.validate()
                if self.trained_s - saved >= SAVE_EVERY_S:
                    saved = self.trained_s
                    self.save()
            if self.count or not self.rows:
                self.validate()
        finally:
            bar.close()
            self.save()
        return self.best()

    def resume(self) -> None:
        """Continue from `last.pt`. Raises ExportError where it belongs to another run."""
        path = self.folder / "last.pt"
        state = read_torch(path, self.resume_format)
        self.restore(state, path)
        ours, theirs = self.network.state_dict(), state["network"]
        if ours.keys() != theirs.keys() or any(ours[name].shape != theirs[name].shape for name in ours):
            raise ExportError(f"{path}: holds {len(theirs)} weights of another network than this run's {len(ours)}")
        self.network.load_state_dict(theirs)
        self.average = {name: tensor.to(self.device) for name, tensor in state["average"].items()}
        self.optimizer.load_state_dict(state["optimizer"])
        self.steps, self.trained_s, self.rows = state["steps"], state["trained_s"], state["rows"]
        self.sums, self.count = state["sums"], state["count"]

    def save(self) -> None:
        """Write `last.pt`, in the first process only; nothing once training has diverged."""
        sums = {name: float(value) for name, value in self.sums.items()}
        if not self.ranks.first or not all(map(math.isfinite, sums.values())):
            return
        kept = {name: getattr(self, name) for name in ("average", "steps", "trained_s", "rows", "count")}
        kept |= {"settings": asdict(self.settings), "sums": sums}
        kept |= {"network": self.network.state_dict(), "optimizer": self.optimizer.state_dict()}
        save_whole({"format": self.resume_format, **self.state(), **kept}, self.folder / "last.pt")

    def means(self, digits: int = 5) -> dict[str, float]:
        """Mean losses since the last call."""
        found = {name: round(float(value) / max(1, self.count), digits) for name, value in self.sums.items()}
        self.sums, self.count = {}, 0
        return found

    def _reads_losses(self) -> bool:
        return self.device.type == "cpu" or self.steps % LOOK_EVERY == 0

    def _show(self, bar: Any) -> None:
        bar.n = round(100 * self.progress(), 1)
        if self._reads_losses():
            loss = float(next(iter(self.sums.values()), 0.0)) / max(1, self.count)
            bar.set_postfix_str(f"step {self.steps} loss {loss:.3f}", refresh=False)
        bar.update(0)


def average_into(average: dict[str, Tensor], network: nn.Module, decay: float) -> None:
    """One step of the exponential moving average of a network's weights, in place."""
    now = network.state_dict()
    floats = [name for name, tensor in now.items() if tensor.is_floating_point()]
    get_ema_multi_avg_fn(decay)([average[name] for name in floats], [now[name] for name in floats], None)
    for name in now.keys() - set(floats):
        average[name].copy_(now[name])


def rate_at(progress: float) -> float:
    """Factor on the learning rate at a share of the budget: linear warm-up, then cosine decay."""
    if progress < WARM_UP:
        return max(0.01, progress / WARM_UP)
    fall = (progress - WARM_UP) / (1.0 - WARM_UP)
    return LAST_RATE + (1.0 - LAST_RATE) * 0.5 * (1.0 + math.cos(math.pi * fall))


def write_curves(rows: Sequence[dict[str, Any]], folder: Path, panels: Panels) -> None:
    """Write `curves.csv` and, with the extra `plot`, `curves.png` over the minutes of training."""
    with (folder / "curves.csv").open("w", newline="") as stream:
        writer = csv.DictWriter(stream, list(dict.fromkeys(key for row in rows for key in row)))
        writer.writeheader()
        writer.writerows(rows)
    try:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure
    except ImportError:
        return
    figure = Figure(figsize=(4.5 * len(panels), 3.6), layout="constrained")
    FigureCanvasAgg(figure)
    minutes = [row["minutes"] for row in rows]
    for axes, (title, lines) in zip(figure.subplots(1, len(panels), squeeze=False)[0], panels.items(), strict=True):
        for part, label in lines.items():
            if any(part in row for row in rows):
                axes.plot(minutes, [row.get(part) for row in rows], "o-", markersize=3, label=label)
        axes.set(xlabel="minutes of training", ylabel=title)
        axes.set_ylim(bottom=0.0)
        axes.grid(alpha=0.3)
        if axes.lines:
            axes.legend(frameon=False)
    figure.savefig(folder / "curves.png", dpi=110)
