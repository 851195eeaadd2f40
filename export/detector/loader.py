"""Batches for training, made ahead in processes; every picture's changes are seeded by epoch and position."""

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import replace

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn.utils.rnn import pad_sequence
from torch.utils.data import DataLoader, Dataset

from edgemap.export.detector.augment import flip, mosaic, plain, recolour, single
from edgemap.export.detector.loss import Targets
from edgemap.export.detector.store import Example
from edgemap.export.errors import ExportError
from edgemap.runtime.frames.reading import one_line

GRID = 32  # px that a size is a multiple of
AHEAD = 3  # batches of each process
COMMON_SHARE = 0.3  # of pictures: a class seen in fewer is shown more often


class Batches(Dataset[tuple[Tensor, Targets]]):
    """Batches of one epoch in an order drawn from (seed, epoch): the same again after a resume, from any batch on.

    mosaic: share of pictures made of four. size: side of the square input, px; a batch is of that size or down to three
    quarters of it, for variety and a fifth less work. mix: share of pictures of each source, whatever it holds; empty
    for every picture once. rank, ranks: this process takes every ranks-th batch of the epoch, from `rank` on. workers:
    processes that prepare pictures; a thread would block the network through Python's global lock.
    """

    def __init__(
        self, examples: Sequence[Example], size: int, batch: int, seed: int, mosaic: float,
        mix: Sequence[float] = (), rank: int = 0, ranks: int = 1, workers: int = 2,
    ) -> None:  # fmt: skip
        self._examples, self._size, self._batch = examples, size, batch
        self._seed, self.mosaic, self._mix = seed, mosaic, tuple(mix)
        self._rank, self._ranks, self._workers = rank, ranks, workers
        sources = np.array([example.source for example in examples])
        often = rarity(examples)
        # A mosaic's pictures are of one source: its labels must cover the same classes in all four.
        self._parts = {source: np.flatnonzero(sources == source) for source in set(sources.tolist())}
        self._chances = {source: np.cumsum(often[rows]) for source, rows in self._parts.items()}

    def __len__(self) -> int:
        """Whole batches of one epoch, of each process."""
        return max(1, len(self._examples) // (self._batch * self._ranks))

    def epoch(self, number: int, first: int = 0) -> Iterator[tuple[Tensor, Targets]]:
        """Batches `first` to the last: pictures (B, 3, size, size) uint8 BGR, and their truth.

        The processes are forked, so that they share the pictures in memory. Raises ExportError where one dies.
        """
        loader = DataLoader(
            self, None, sampler=[(number, index) for index in range(first, len(self))], num_workers=self._workers,
            multiprocessing_context="fork", prefetch_factor=AHEAD, worker_init_fn=lambda _: cv2.setNumThreads(0),
        )  # fmt: skip
        try:
            yield from loader
        except RuntimeError as error:
            raise ExportError(f"a process that makes training pictures died ({one_line(error, 100)})") from None

    def __getitem__(self, at: tuple[int, int]) -> tuple[Tensor, Targets]:
        """One batch, by epoch and index."""
        (epoch, index), order = at, self.order(at[0])
        first = (index * self._ranks + self._rank) * self._batch
        steps = np.random.default_rng([self._seed, epoch, index, 1]).integers(self._size // (4 * GRID) + 1)
        size = self._size - GRID * int(steps)
        return collate([self._one(epoch, at, order, size) for at in range(first, first + self._batch)])

    def order(self, epoch: int) -> NDArray[np.int64]:
        """Indices of the pictures in the order in which an epoch shows them."""
        generator = np.random.default_rng([self._seed, epoch])
        if not self._mix:
            return generator.permutation(len(self._examples))
        parts = []
        for source, share in enumerate(self._mix):
            if (own := self._parts.get(source)) is not None:
                wanted = round(share / sum(self._mix) * len(self._examples))
                rounds = [generator.permutation(own) for _ in range(-(-wanted // len(own)))]
                parts.append(np.concatenate([own[:0], *rounds])[:wanted])
        return generator.permutation(np.concatenate(parts))

    def _one(self, epoch: int, position: int, order: np.ndarray, size: int) -> Example:
        generator = np.random.default_rng([self._seed, epoch, position])
        example = self._examples[order[position % len(order)]]
        if generator.random() < self.mosaic:
            rows, chances = self._parts[example.source], self._chances[example.source]
            others = rows[np.searchsorted(chances, generator.random(3) * chances[-1], side="right")]
            made = mosaic([example, *(self._examples[at] for at in others)], size, generator)
        elif generator.random() < 0.7:
            made = single(example, size, generator)
        else:
            made = plain(example, size, generator.random() < 0.5)
        if generator.random() < 0.5:
            made = flip(made)
        return replace(made, image=recolour(made.image, generator), complete=example.complete, kept=example.kept)


def rarity(examples: Sequence[Example]) -> NDArray[np.float64]:
    """How often to add each picture to mosaics, 1 or more: sqrt(common / share of its rarest class), at most 4.

    Repeat factors (Gupta et al. 2019) balance rare classes (one oven) against frequent ones (chairs).
    """
    shown = [set(example.labels[~example.ignored()].tolist()) for example in examples]
    counts = Counter(label for labels in shown for label in labels)
    factors = {label: (COMMON_SHARE * len(examples) / count) ** 0.5 for label, count in counts.items()}
    return np.array([min(4.0, max([1.0, *(factors[label] for label in labels)])) for labels in shown])


def collate(examples: Sequence[Example]) -> tuple[Tensor, Targets]:
    """Pictures of one size as one tensor, their boxes padded to the longest list."""
    images = torch.from_numpy(np.stack([example.image for example in examples])).permute(0, 3, 1, 2)
    targets = Targets(
        _padded([example.boxes for example in examples]),
        _padded([example.labels for example in examples]),
        _padded([~example.ignored() for example in examples]),
        _padded([example.ignored() for example in examples]),
        torch.from_numpy(np.stack([example.complete for example in examples])),
        torch.from_numpy(np.stack([example.kept for example in examples])),
        _padded([example.certainty() for example in examples]),
    )
    # NHWC memory is what oneDNN's convolutions want; the permutation above gives it for free.
    return images, targets


def _padded(columns: Sequence[NDArray]) -> Tensor:
    """(B, G, …) of (N, …) each: zeros behind the shorter ones; one row at least."""
    whole = [torch.from_numpy(column) for column in columns]
    return pad_sequence([*whole, whole[0].new_zeros(1, *whole[0].shape[1:])], batch_first=True)[:-1]
