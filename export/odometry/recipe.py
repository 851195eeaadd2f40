"""How each kind of head is trained (loss, optimiser, clips), run over a drive, and judged on whole drives."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from edgemap.evaluation.odometry import INDOOR_LENGTHS_M, KITTI_LENGTHS_M, errors_of, figures
from edgemap.evaluation.trajectory import integrated, path_m
from edgemap.export.odometry.clips import LONGEST_DT_S, Clips, Shelf, make_batch
from edgemap.export.odometry.data import FeatureDrive
from edgemap.export.odometry.flow import FlowHead
from edgemap.export.odometry.flow_loss import MOTION_SIGMA, ClipBatch, flow_loss, run_clip
from edgemap.export.odometry.paper import PaperHead
from edgemap.export.training import Schedule
from edgemap.geometry.se2 import SE2

CHUNK = 30  # frames at once

# A head over a batch of clips with the state before it: motions (B, T, 3), covariances (B, T, 3, 3) or None, new state.
Unroll = Callable[[Any, ClipBatch, list[Tensor] | None], tuple[Tensor, Tensor | None, list[Tensor]]]


@torch.no_grad()
def estimate(
    head: nn.Module, unroll: Unroll, drive: FeatureDrive, window: int = 0
) -> tuple[list[SE2], np.ndarray | None]:
    """A head's motions of one drive, one fewer than frames, and their covariances where it has any.

    window: motions after which the state starts again from the last frame; 0 for never.
    """
    shelf = Shelf((), next(head.parameters()).device)
    state: list[Tensor] | None = None
    motions, covariances = [], []
    count = len(drive.stamps_s)
    chunk = window or CHUNK
    for start in range(0, count - 1, chunk):
        indices = np.arange(start, min(count, start + chunk + 1))
        found, doubt, state = unroll(head, make_batch([(drive, indices)], shelf), None if window else state)
        motions.append(found[0].cpu().numpy())
        if doubt is not None:
            covariances.append(doubt[0].cpu().numpy())
    steps = [SE2(*row) for row in np.concatenate(motions)]
    return steps, np.concatenate(covariances).astype(np.float64) if covariances else None


def segment_lengths_m(unit_m: float, path_m: float) -> tuple[float, ...]:
    """The lengths over which a head that counts in this unit is judged: as a robot at home, or, where the unit is a
    road's, those of KITTI that are shorter than the path."""
    if unit_m == 1.0:
        return INDOOR_LENGTHS_M
    return tuple(m for m in KITTI_LENGTHS_M if m < path_m) or tuple(unit_m * m for m in INDOOR_LENGTHS_M)


def validate(head: nn.Module, unroll: Unroll, drives: Sequence[FeatureDrive], window: int = 0) -> dict[str, Any]:
    """Drift over all `segment_lengths_m`, per-step RMSE and NEES over all drives; `score` is what chooses."""
    head.eval()
    unit_m = head.unit_m if isinstance(head, FlowHead) else 1.0
    errors = []
    for drive in drives:
        steps, covariances = estimate(head, unroll, drive, window)
        true = [SE2(*row) for row in drive.poses]
        lengths_m = segment_lengths_m(unit_m, float(path_m(true)[-1]))
        errors.append(errors_of(true, integrated(steps), covariances, lengths_m))
    found = figures(errors)
    drifts = {f"t{length}_percent": value for length, value in found["t_rel_percent"].items()}
    summary: dict[str, Any] = {name: value for name, value in drifts.items() if value is not None}
    # Drift over the lengths that fit (short drives at high rates have no long ones), else the yaw, where it comes from.
    score = sum(summary.values()) / len(summary) if summary else found["rmse_yaw_rad"]
    summary |= {name: found[name] for name in ("rmse_forward_m", "rmse_left_m", "rmse_yaw_rad")}
    if found["nees"] is not None:
        summary |= {"nees_mean": found["nees"], "nees_median": found["nees_median"]}
    return summary | {"drives": len(drives), "path_m": round(found["path_m"], 1), "score": score}


LAMBDA = 100.0  # of the paper's equation 2: what a radian's square counts against a metre's


@dataclass(frozen=True)
class Recipe:
    """loss: of a head on a batch at a share of the training, with its parts. rate: factor on `highest_rate` at a share
    of the training and a step. unroll: runs the head over a clip. window: number of motions after which the state is
    reset on whole drives, 0 for never. vary: augments a batch."""

    kind: str
    clips: Clips
    highest_rate: float
    optimizer: Callable[[nn.Module], torch.optim.Optimizer]
    rate: Callable[[float, int], float]
    loss: Callable[[Any, ClipBatch, float], tuple[Tensor, dict[str, Tensor]]]
    unroll: Unroll
    window: int = 0
    vary: Callable[[Any, ClipBatch, np.random.Generator], ClipBatch] = lambda _head, batch, _rng: batch

    @staticmethod
    def envelope(drives: Sequence[FeatureDrive]) -> dict[str, tuple[float, float]]:
        """The range of the training data: camera height m, pitch deg, half the field of view, frame times, speeds."""
        heights = [float(drive.mount[0, 11]) for drive in drives]
        pitches = [math.degrees(-math.asin(float(np.clip(drive.mount[0, 8], -1.0, 1.0)))) for drive in drives]
        views = [2.0 * math.degrees(math.atan(float(np.abs(drive.cells[0, 0]).max()))) for drive in drives]
        rates = [1.0 / float(np.median(np.diff(drive.stamps_s))) for drive in drives]
        names = ("height_m", "pitch_deg", "horizontal_view_deg", "rate_hz")
        spans = {
            name: (round(min(values), 2), round(max(values), 2))
            for name, values in zip(names, (heights, pitches, views, rates), strict=True)
        }
        # With pictures left out a drive is one of a slower camera.
        slowest = min(rate / max(1.0, math.floor(rate * LONGEST_DT_S + 1e-6)) for rate in rates)
        return spans | {"rate_hz": (round(slowest, 2), spans["rate_hz"][1])}


@dataclass(frozen=True, slots=True)
class FewDrives:
    """Regularisation for short drives: on KITTI's frames 0 to 399, rotated views and these settings reduced the drift
    of the next hundred from 6.1 to 2.5 % over 50 m. sizes: natural logarithm, at most, of the factor on a clip's world.
    dropped: share of a clip's feature channels that are their mean. yaw_sigma_rad: of one step, that counts as a small
    error; a road is long. weight_decay: of AdamW.
    """

    sizes: float = 0.3
    dropped: float = 0.1
    yaw_sigma_rad: float = 0.002
    weight_decay: float = 0.01

    def varied(self, head: FlowHead, batch: ClipBatch, rng: np.random.Generator) -> ClipBatch:
        """A batch with each clip's world larger or smaller, and some of its channels without information."""
        clips, _, channels = batch.features.shape[:3]
        drawn = torch.from_numpy(np.exp(rng.uniform(-self.sizes, self.sizes, clips)).astype(np.float32))
        size = drawn.to(batch.features.device)[:, None]
        kept = torch.from_numpy(rng.random((clips, 1, channels, 1, 1)) >= self.dropped).to(batch.features.device)
        floor, lens = batch.cells[:, :, 6:7] / size[..., None, None, None], batch.mount[:, :, 9:] * size[..., None]
        return ClipBatch(
            torch.where(kept, batch.features, head.feature_mean[:, None]),
            torch.cat([batch.cells[:, :, :6], floor, batch.cells[:, :, 7:]], dim=2),
            torch.cat([batch.mount[:, :, :9], lens], dim=2),
            batch.dt_s,
            torch.cat([batch.motions[:, :, :2] * size[..., None], batch.motions[:, :, 2:]], dim=2),
        )


def flow_recipe(rate: float = 1e-3, length: int = 8, few: FewDrives | None = None) -> Recipe:
    """AdamW with a cosine, the loss of `flow_loss`. few: where views of few drives are trained on."""

    def optimizer(head: nn.Module) -> torch.optim.Optimizer:
        decay = 1e-3 if few is None else few.weight_decay
        return torch.optim.AdamW(head.parameters(), lr=rate, weight_decay=decay)

    def unroll(head: FlowHead, batch: ClipBatch, state: list[Tensor] | None) -> Any:
        searches, new = run_clip(head, batch, state)
        motions, covariances = zip(*(head.metric(second.solution) for _, second in searches), strict=True)
        return torch.stack(motions, dim=1), torch.stack(covariances, dim=1), new

    recipe = Recipe("flow", Clips(length), rate, optimizer, lambda share, _: Schedule.rate(share), flow_loss, unroll)
    if few is None:
        return recipe
    sigma = torch.cat([MOTION_SIGMA[:2], torch.tensor([few.yaw_sigma_rad])])
    return replace(recipe, loss=partial(flow_loss, sigma=sigma), vary=few.varied)


def paper_recipe(length: int = 10, factor: float = 1.0) -> Recipe:
    """The paper's section 4.3: AdaGrad, rate 0.005 for 100 iterations, then 0.001; equation 2 as the loss.

    length: of the sequences, which the paper does not state. Nothing is skipped or turned round. factor: on the rates.
    """

    def optimizer(head: nn.Module) -> torch.optim.Optimizer:
        return torch.optim.Adagrad(head.parameters(), lr=0.005 * factor)

    def rate(_share: float, step: int) -> float:
        return 1.0 if step < 100 else 0.2

    def loss(head: PaperHead, batch: ClipBatch, _share: float) -> tuple[Tensor, dict[str, Tensor]]:
        found, _, _ = unroll(head, batch, None)
        return equation_2(found, batch.motions[:, 1:]), {}

    def unroll(head: PaperHead, batch: ClipBatch, state: list[Tensor] | None) -> Any:
        clips, frames = batch.features.shape[:2]
        now = state or [batch.features.new_zeros(clips, *shape[1:]) for shape in head.state_shapes.values()]
        motions = []
        first = 0 if state is None else 1
        for index in range(first, frames):
            motion, *now = head(batch.features[:, index], *now)
            if index > 0:
                motions.append(motion)
        return torch.stack(motions, dim=1), None, now

    clips = Clips(length, skips=(1,), backwards=0.0, still=0.0)
    # With leaky ReLU nothing bounds the cell: trained on short sequences it runs away on long ones.
    return Recipe("paper", clips, 0.005 * factor, optimizer, rate, loss, unroll, length - 1)


def equation_2(found: Tensor, true: Tensor) -> Tensor:
    """Mean over all steps of the squared error of the position plus lambda times that of the yaw."""
    error = found - true
    yaw = torch.atan2(torch.sin(error[..., 2]), torch.cos(error[..., 2]))
    return (error[..., :2].square().sum(dim=-1) + LAMBDA * yaw.square()).mean()
