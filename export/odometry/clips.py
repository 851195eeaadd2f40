"""Random clips of drives: other frame rates by skipped pictures, reversed order, rest; features need no
recomputation."""

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from edgemap.export.errors import ExportError
from edgemap.export.odometry.data import FeatureDrive
from edgemap.export.odometry.flow import COARSE_ROWS
from edgemap.export.odometry.flow_loss import ClipBatch

LONGEST_DT_S = 0.25
FASTEST_YAW_RAD = 0.30  # of one step that skips pictures; limit of the search
KNOWN_ATTITUDE = 0.75  # share of a nodding robot's clips with each frame's attitude; the others have the mount only
ATTITUDE_SIGMA_DEG = (0.2, 0.5)  # standard deviation of a clip's attitudes, as a filter's
ATTITUDE_LASTS_S = 2.0  # correlation time of its errors (Gauss-Markov, first order)

Chosen = tuple[FeatureDrive, NDArray[np.intp]]  # a drive and the frames of a clip


@dataclass(frozen=True, slots=True)
class Clips:
    """How clips are drawn. length: frames. skips: numbers of skipped pictures, as far as `LONGEST_DT_S` allows."""

    length: int = 8
    skips: tuple[int, ...] = (1, 2, 3, 4, 5, 6)
    backwards: float = 0.3
    still: float = 0.05


def reach_m(drive: FeatureDrive) -> float:
    """Longest motion of the base in a step that skips pictures: with it the nearest floor in view moves in the picture
    by the range of the search. 0.2 m for robots at home, 3 m for KITTI's car; no bound without floor."""
    floor, down = drive.cells[0, 6], np.abs(drive.cells[0, 5])
    nearest = np.unravel_index(int(floor.argmax()), floor.shape)
    if floor[nearest] <= 0.0:
        return math.inf
    share = COARSE_ROWS * float(down[nearest]) / (float(floor[nearest]) * float(drive.mount[0, 11]))
    return share / (1.0 + share) / float(floor[nearest])


class ClipDraws:
    """Draws clips of some drives. All frame rates of drives and skips are equally frequent; within a rate, drives in
    proportion to their length. Raises ExportError for a drive that is too short."""

    def __init__(self, rule: Clips, drives: Sequence[FeatureDrive]) -> None:
        self.rule = rule
        self._choices: list[tuple[FeatureDrive, int]] = []
        self._reach_m = {drive: reach_m(drive) for drive in drives}
        rates, lengths = [], []
        for drive in drives:
            if len(drive) < rule.length:
                raise ExportError(f"{drive.name}: {len(drive)} frames, clips need {rule.length}")
            frame_s = drive.frame_s
            for skip in {k for k in rule.skips if k * frame_s <= LONGEST_DT_S} or {1}:
                if (rule.length - 1) * skip < len(drive):
                    self._choices.append((drive, skip))
                    rates.append(round(100.0 * skip * frame_s))
                    lengths.append(len(drive))
        of_rate = Counter[int]()
        for rate, length in zip(rates, lengths, strict=True):
            of_rate[rate] += length
        weights = np.array([length / of_rate[rate] for rate, length in zip(rates, lengths, strict=True)])
        self._shares = weights / weights.sum()

    def draw(self, rng: np.random.Generator) -> Chosen:
        """A random clip of a random drive."""
        rule = self.rule
        while True:
            drive, skip = self._choices[int(rng.choice(len(self._choices), p=self._shares))]
            first = int(rng.integers(0, len(drive) - (rule.length - 1) * skip))
            indices = first + np.arange(rule.length) * skip
            if rng.random() < rule.backwards:
                indices = indices[::-1].copy()
            if rng.random() < rule.still:
                stop = int(rng.integers(1, rule.length))
                indices[stop:] = indices[stop]
            motions = np.abs(drive.motions(indices))
            if skip == 1 or (motions[:, 2].max() < FASTEST_YAW_RAD and motions[:, :2].max() < self._reach_m[drive]):
                return drive, indices


class Shelf:
    """Features of drives for a device: all of them in the memory of a GPU, those of each clip on a processor."""

    def __init__(self, drives: Sequence[FeatureDrive], device: torch.device) -> None:
        self.device = device
        self._first: dict[FeatureDrive, int] = {}
        if device.type == "cpu" or not drives:
            return
        shape = (sum(map(len, drives)), *drives[0].features.shape[1:])
        self._all = torch.empty(shape, dtype=torch.float16, device=device)
        first = 0
        for drive in drives:
            self._all[first : first + len(drive)] = torch.from_numpy(np.ascontiguousarray(drive.features)).to(device)
            self._first[drive] = first
            first += len(drive)

    def take(self, chosen: Sequence[Chosen]) -> torch.Tensor:
        """Features of clips of one length, (B, T, C, H, W) float32."""
        if all(drive in self._first for drive, _ in chosen):
            rows = np.stack([self._first[drive] + indices for drive, indices in chosen])
            return self._all[self.place(rows).flatten()].unflatten(0, rows.shape).float()
        clips = [np.stack([drive.features[index] for index in indices]).astype(np.float32) for drive, indices in chosen]
        return self.place(np.stack(clips))

    def place(self, values: NDArray[np.generic]) -> torch.Tensor:
        """Values on the device; the copy is asynchronous."""
        tensor = torch.from_numpy(values)
        return tensor if self.device.type == "cpu" else tensor.pin_memory().to(self.device, non_blocking=True)


def make_batch(
    chosen: Sequence[Chosen], shelf: Shelf | None = None, rng: np.random.Generator | None = None
) -> ClipBatch:
    """Clips as one batch on the shelf's device. rng: draws errors of the attitudes; None for the true attitudes."""
    shelf = shelf or Shelf((), torch.device("cpu"))
    dt_s, motions, mounts = [], [], []
    for drive, indices in chosen:
        steps = np.abs(np.diff(drive.stamps_s[indices]))
        frame_s = float(steps.max(initial=0.0)) or drive.frame_s
        steps = np.where(steps > 0.0, steps, frame_s)
        dt_s.append(np.concatenate([[frame_s], steps]))
        motions.append(np.concatenate([np.zeros((1, 3)), drive.motions(indices)]))
        mounts.append(_mounts(drive, indices, dt_s[-1], rng))
    cells = shelf.place(np.concatenate([drive.cells for drive, _ in chosen]))[:, None].expand(
        -1, len(dt_s[0]), -1, -1, -1
    )
    mount = shelf.place(np.stack(mounts))
    if any(drive.angles is not None for drive, _ in chosen):
        cells = _with_mounts(cells, mount)
    return ClipBatch(
        shelf.take(chosen),
        cells,
        mount,
        shelf.place(np.stack(dt_s).astype(np.float32)),
        shelf.place(np.stack(motions).astype(np.float32)),
    )


def _mounts(
    drive: FeatureDrive, indices: NDArray[np.intp], dt_s: NDArray[np.float64], rng: np.random.Generator | None
) -> NDArray[np.float32]:
    """The mount of each frame as the head's input, (T, 12): the true attitude with a filter's error."""
    if drive.angles is None or (rng is not None and rng.random() >= KNOWN_ATTITUDE):
        return np.repeat(drive.mount, len(indices), axis=0)
    angles = drive.angles[indices]
    if rng is not None:
        errors = rng.normal(0.0, math.radians(rng.uniform(*ATTITUDE_SIGMA_DEG)), (len(indices), 2))
        for index in range(1, len(indices)):
            kept = math.exp(-dt_s[index] / ATTITUDE_LASTS_S)
            errors[index] = kept * errors[index - 1] + math.sqrt(1.0 - kept * kept) * errors[index]
        angles = angles + np.column_stack([errors, np.zeros(len(indices))])
    return np.stack([drive.mount_at(*row) for row in angles])


def _with_mounts(cells: torch.Tensor, mount: torch.Tensor) -> torch.Tensor:
    """Cells (B, T, 8, h, w) with the floor seen from each frame's mount, (B, T, 12); see `flow_cells`."""
    x, y, shown = cells[:, :, 0], cells[:, :, 1], cells[:, :, 7]
    right, down, ahead, height_m = (mount[:, :, place, None, None] for place in (6, 7, 8, 11))
    floor = -(right * x + down * y + ahead * shown).clamp_max(0.0) / height_m
    return torch.cat([cells[:, :, :6], floor[:, :, None], cells[:, :, 7:]], dim=2)
