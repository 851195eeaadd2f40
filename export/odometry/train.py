"""Trains the paper's head by its section 4.3 on cached features: clips, equation 2, validation on complete drives."""

from collections.abc import Iterator, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from edgemap.evaluation.odometry import errors_of, figures
from edgemap.evaluation.trajectory import integrated
from edgemap.export.errors import ExportError
from edgemap.export.odometry.checkpoint import HeadCheckpoint, load_head, save_head
from edgemap.export.odometry.data import FeatureDrive, FeatureStore
from edgemap.export.odometry.paper import PaperHead, random_head
from edgemap.export.settings import OdometrySettings
from edgemap.export.training import Training
from edgemap.geometry.se2 import SE2

CLIP_NORM = 1.0
FIRST_STEPS, LATER = 100, 0.2  # AdaGrad's rate: 0.005 for 100 iterations, then 0.001
LAMBDA = 100.0  # of the paper's equation 2: what a radian's square counts against a metre's
MIRROR = np.array([1.0, -1.0, -1.0], np.float32)  # of a motion
SAMPLES = 64  # frames that mean and deviation are taken from
PANELS = {  # the first is the paper's figure 6
    "loss": {"loss": "loss"},
    "validation drift, % of the way": {f"t{length}_percent": f"over {length} m" for length in (5, 2, 1)},
}


def begin(
    store: FeatureStore, drives: Sequence[FeatureDrive], backbone: str, feature: str, seed: int, start: Path | None
) -> HeadCheckpoint:
    """The head to train for a store's features: seeded random weights, or an earlier head's. Raises ExportError."""
    if start is not None:
        earlier = load_head(start)
        if earlier.head.shape != store.shape:
            raise ExportError(f"{start}: a head for features {earlier.head.shape}, not for {store.shape}")
        return HeadCheckpoint(earlier.head, backbone, feature)
    rng, head = np.random.default_rng(seed), random_head(store.shape, seed)
    chosen = [drives[int(rng.integers(len(drives)))] for _ in range(SAMPLES)]
    sample = torch.from_numpy(np.stack([d.features[int(rng.integers(len(d)))] for d in chosen]).astype(np.float32))
    mean = sample.mean(dim=(0, 2, 3), keepdim=True)
    head.feature_mean.copy_(mean)  # a channel that hardly changes is mostly rounding: it is not scaled up
    head.feature_std.copy_(sample.std(dim=(0, 2, 3), keepdim=True) + 1e-3 + 0.01 * mean.abs())
    head.motion_scale.copy_(torch.from_numpy(np.concatenate([drive.motions for drive in drives]).std(axis=0) + 1e-3))
    return HeadCheckpoint(head, backbone, feature)


class HeadTraining(Training[PaperHead, OdometrySettings]):
    """One training of a head; writes `best.pt`, `last.pt`, `curves.csv` and `curves.png` to its folder.

    start: the initial head. train, validation: drives with features. length: frames of a sequence, which the paper does
    not state. mirror: of a `FeatureStore`: half of the clips are mirrored. Raises ExportError for a drive that is
    shorter.
    """

    resume_format = "edgemap.head-run/2"
    highest = False  # the least error is the best
    average_steps = 300
    panels = PANELS

    def __init__(
        self,
        start: HeadCheckpoint,
        train: Sequence[FeatureDrive],
        validation: Sequence[FeatureDrive],
        folder: Path,
        settings: OdometrySettings,
        length: int = 10,
        mirror: NDArray[np.float32] | None = None,
    ) -> None:
        super().__init__(folder, settings, start.head, torch.optim.Adagrad, settings.steps)
        self.start, self.train, self.validation, self.length = start, train, validation, length
        for drive in train:
            if len(drive) < length:
                raise ExportError(f"{drive.name}: {len(drive)} frames, sequences need {length}")
        self._motions, self._mirror = [drive.motions for drive in train], mirror
        self._clips = [(index, first) for index, drive in enumerate(train) for first in range(len(drive) - length + 1)]

    def take_steps(self) -> Iterator[None]:
        """Train step by step: draw clips, compute the loss, descend. Seed and step number determine the clips."""
        while self.progress() < 1.0:
            rng = np.random.default_rng((self.settings.seed, self.steps))
            features, motions = self._batch(rng)
            with torch.autocast(self.device.type, torch.bfloat16, enabled=self.settings.bfloat16):
                loss = equation_2(unroll(self.network, features), motions)
            rate = self.settings.rate * (1.0 if self.steps < FIRST_STEPS else LATER)
            self.learn(loss, {"loss": loss.detach().double()}, rate, CLIP_NORM)
            yield

    def _batch(self, rng: np.random.Generator) -> tuple[Tensor, Tensor]:
        """Features (B, T, C, H, W) and motions (B, T - 1, 3) of random clips, each as likely as any other."""
        features, motions = [], []
        for index, first in (self._clips[at] for at in rng.integers(len(self._clips), size=self.settings.batch)):
            clip = self.train[index].features[first : first + self.length].astype(np.float32)
            motion = self._motions[index][first : first + self.length - 1]
            if self._mirror is not None and rng.random() < 0.5:
                clip, motion = clip[..., ::-1] * self._mirror[:, None, None], motion * MIRROR
            features.append(clip)
            motions.append(motion)
        batch = np.stack(features), np.stack(motions)
        return torch.from_numpy(batch[0]).to(self.device), torch.from_numpy(batch[1]).to(self.device)

    def validate(self) -> None:
        """Validate the averaged weights on complete drives."""
        head = self.averaged()
        found = validate(head, self.validation, self.length - 1)
        if self.enter({"steps": self.steps, **self.means(7), **found}):
            sigma = found["rmse_forward_m"], found["rmse_left_m"], found["rmse_yaw_rad"]
            training = {"drives": len(self.train), "settings": asdict(self.settings), **self.rows[-1]}
            measured = {"training": training, "validation": found | {"drives": len(self.validation)}}
            best = replace(self.start, head=head.cpu(), sigma=sigma, measured=measured, window=self.length - 1)
            save_head(best, self.folder / "best.pt")

    def state(self) -> dict[str, Any]:
        """The backbone."""
        return {"backbone": self.start.backbone}

    def restore(self, state: dict[str, Any], path: Path) -> None:
        """Raises ExportError for another backbone."""
        if state["backbone"] != self.start.backbone:
            raise ExportError(f"{path}: a head for {state['backbone']}, not this run's")


def unroll(head: PaperHead, features: Tensor) -> Tensor:
    """Motions (B, T - 1, 3) of clips (B, T, C, H, W) from the initial state."""
    state = [features.new_zeros(len(features), *shape[1:]) for shape in head.state_shapes.values()]
    motions = []
    for index in range(features.shape[1]):
        motion, *state = head(features[:, index], *state)
        motions.append(motion)
    return torch.stack(motions[1:], dim=1)


def equation_2(found: Tensor, true: Tensor) -> Tensor:
    """Mean over all steps of the squared error of the position plus lambda times that of the yaw."""
    error = found - true
    yaw = torch.atan2(torch.sin(error[..., 2]), torch.cos(error[..., 2]))
    return (error[..., :2].square().sum(dim=-1) + LAMBDA * yaw.square()).mean()


@torch.no_grad()
def estimate(head: PaperHead, features: NDArray[np.float16], window: int) -> list[SE2]:
    """Motions of one drive, one fewer than frames; after every `window` the state starts again from the last frame:
    with leaky ReLU nothing bounds the cell, which runs away beyond the length of its training."""
    device, motions = head.feature_mean.device, []
    for first in range(0, len(features) - 1, window):
        clip = torch.from_numpy(features[first : first + window + 1].astype(np.float32)).to(device)
        motions.append(unroll(head, clip[None])[0].cpu().numpy())
    return [SE2(*row) for row in np.concatenate(motions)]


def validate(head: PaperHead, drives: Sequence[FeatureDrive], window: int) -> dict[str, Any]:
    """Drift in per cent over the lengths that fit and RMSE of a step over all drives; `score`, equation 2, chooses."""
    found = figures([errors_of(drive.poses, integrated(estimate(head, drive.features, window))) for drive in drives])
    drifts = {f"t{length}_percent": value for length, value in found["t_rel_percent"].items() if value is not None}
    rmse = {name: found[name] for name in ("rmse_forward_m", "rmse_left_m", "rmse_yaw_rad")}
    forward, left, yaw = rmse.values()
    return drifts | rmse | {"path_m": round(found["path_m"], 1), "score": forward**2 + left**2 + LAMBDA * yaw**2}
