"""A smaller flow head from a larger one by least squares, layer by layer: no gradient, a minute of one core.

Each layer of the small head is fitted so that, from what the small head computed before it, it reproduces the large
head's layer; the most informative channels are kept (pivoted QR, weighted by their readers). Channel pruning by
reconstruction, after He, Zhang and Sun 2017, without its iterations.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
import scipy.linalg
import torch
from torch import Tensor, nn
from torch.nn import functional

from edgemap.export.odometry.correlation import SLOPE
from edgemap.export.odometry.data import FeatureDrive
from edgemap.export.odometry.flow import COARSE_COLUMNS, COARSE_ROWS, FlowHead
from edgemap.export.odometry.rigid import CellGeometry

LAYERS = ("search.0", "search.2", "tell", "narrow", "refine.0", "refine.2", "retell", "remember", "gates")
SKIPS = (1, 2, 1, 1, 3, 1, 1, 2)  # of pictures, drive by drive: slower cameras are learnt from as well
EVERY = 5  # of so many steps one is looked at
ROWS = 12_000  # cells among which channels are chosen
RIDGE = 3e-5


@dataclass(frozen=True, slots=True, eq=False)
class _Step:
    """One step of the large head: what the small head reads then (features before and now, geometry, state), and what
    the large one's layers gave, by name."""

    drive: FeatureDrive
    before: int
    now: int
    dt_s: Tensor
    geometry: CellGeometry
    hidden: Tensor
    cell: Tensor
    velocity: Tensor
    expected: Tensor
    gave: dict[str, Tensor]


@torch.no_grad()
def fit_smaller(
    small: FlowHead, large: FlowHead, pairs: Sequence[tuple[FeatureDrive, FeatureDrive]], every: int = EVERY
) -> None:
    """Fit the small head to the large one. pairs: the same drives as features of the small and the large head, with
    corresponding cells. every: stride of the sampled steps.
    """
    small.unit_m = large.unit_m
    steps = [
        step for index, pair in enumerate(pairs) for step in _steps(large, *pair, SKIPS[index % len(SKIPS)], every)
    ]
    _describe(small, large, pairs)
    kept = _kept_channels(small, large, steps)
    units = kept["hidden"]
    means = torch.stack([step.hidden[0, units].mean(dim=(1, 2)) for step in steps])
    _solve(small.expect, *_sums([(means, torch.cat([step.expected for step in steps]), means.new_ones(1))]), ridge=1e-3)
    for name in LAYERS:
        conv = small.get_submodule(name)
        assert isinstance(conv, nn.Conv2d)
        pieces = (_rows(small, conv, name, step, kept) for step in steps)
        _solve(conv, *_sums(pieces))


def _steps(large: FlowHead, own: FeatureDrive, theirs: FeatureDrive, skip: int, every: int) -> list[_Step]:
    """Some steps of the large head along a drive."""
    gave: dict[str, Tensor] = {}

    def keep(name: str) -> Callable[..., None]:
        def hook(_module: nn.Module, _inputs: tuple[Tensor, ...], output: Tensor) -> None:
            gave[name] = output

        return hook

    hooks = [large.get_submodule(name).register_forward_hook(keep(name)) for name in LAYERS]
    device = large.sharpness.device
    cells, mount = torch.from_numpy(theirs.cells).to(device), torch.from_numpy(theirs.mount).to(device)
    geometry, found = CellGeometry.of(cells, mount, large.unit_m), []
    hidden, cell, velocity = (
        torch.zeros(large.state_shapes[name], device=device) for name in ("hidden", "cell", "velocity")
    )
    for count, (before, now) in enumerate(pairwise(range(0, len(theirs), skip))):
        fine_before, coarse_before = large.describe(_feature(theirs, before, device))
        fine, coarse = large.describe(_feature(theirs, now, device))
        dt_s = torch.tensor([[theirs.stamps_s[now] - theirs.stamps_s[before]]], dtype=torch.float32).to(device)
        _, last, new_hidden, new_cell = large.match(
            fine, coarse, geometry, dt_s, fine_before, coarse_before, hidden, cell, velocity
        )
        if count % every == every - 1:
            expected = large.expect(hidden.mean(dim=(2, 3)))
            state = hidden, cell, velocity, expected
            found.append(_Step(own, before, now, dt_s, geometry, *state, dict(gave)))
        hidden, cell, velocity = new_hidden, new_cell, last.solution.motion / dt_s
    for hook in hooks:
        hook.remove()
    return found


def _describe(small: FlowHead, large: FlowHead, pairs: Sequence[tuple[FeatureDrive, FeatureDrive]]) -> None:
    """Cells described by the directions in which the large head's descriptions differ most."""
    device = large.sharpness.device
    places = [(own, theirs, index) for own, theirs in pairs for index in (len(own) // 9, len(own) // 2, -1)]
    theirs = torch.cat([_feature(drive, index, device) for _, drive, index in places])
    own = (
        theirs
        if pairs[0][0] is pairs[0][1]
        else torch.cat([_feature(drive, index, device) for drive, _, index in places])
    )
    raw = large.describe_fine(theirs)
    fine, coarse = large.describe(theirs)
    turn = _main_directions(fine, small.sizes.fine)
    wanted = torch.einsum("ij,bjvu->bivu", turn, raw)
    scaled = (own - small.feature_mean) / small.feature_std
    _solve(small.reduce, *_sums([(_patches(small.reduce, scaled), _cells(wanted), wanted.new_ones(1))]))
    wanted = torch.einsum("ij,bjvu->bivu", _main_directions(coarse, small.sizes.coarse), coarse)
    inputs = functional.leaky_relu(small.describe_fine(own), SLOPE)
    _solve(small.coarsen, *_sums([(_patches(small.coarsen, inputs), _cells(wanted), wanted.new_ones(1))]))
    small.sharpness.copy_(large.sharpness)
    small.evidence.copy_(large.evidence)


def _kept_channels(small: FlowHead, large: FlowHead, steps: Sequence[_Step]) -> dict[str, Tensor]:
    """Which of the large head's channels the small one keeps, layer by layer, and of the memory (`hidden`)."""
    sizes, wide = small.sizes, large.sizes
    memory = (2 * COARSE_ROWS + 1) * (2 * COARSE_COLUMNS + 1) + wide.coarse  # where the search reads it
    readers = {
        "search.0": (sizes.width, [("search.2", 0)]),
        "search.2": (sizes.width, [("tell", 0), ("refine.0", wide.narrow)]),
        "narrow": (sizes.narrow, [("refine.0", 0)]),
        "refine.0": (sizes.width, [("refine.2", 0)]),
        "refine.2": (sizes.width, [("retell", 0), ("remember", 0)]),
        "remember": (sizes.hidden, [("gates", 0)]),
    }
    weights = dict(large.named_parameters())
    kept = {}
    for name, (count, read_by) in readers.items():
        convs = [(weights[f"{reader}.weight"], at) for reader, at in read_by]
        gave = torch.cat([step.gave[name] for step in steps])
        kept[name] = _informative(gave if name == "remember" else functional.leaky_relu(gave, SLOPE), convs, count)
    hidden = torch.cat([step.hidden for step in steps])
    importance = 3.0 * large.expect.weight.norm(dim=0)
    kept["hidden"] = _informative(hidden, [(weights["search.0.weight"], memory)], sizes.hidden, importance)
    kept["gates"] = torch.cat([kept["hidden"] + part * wide.hidden for part in range(4)])
    return kept


def _informative(
    values: Tensor, readers: Sequence[tuple[Tensor, int]], count: int, also: Tensor | float = 0.0
) -> Tensor:
    """The most informative channels of values (B, C, H, W). readers: weights of what reads them, and
    from which of its inputs on."""
    rows = _cells(values)
    chosen = rows[torch.randperm(len(rows), generator=torch.Generator().manual_seed(0))[:ROWS].to(rows.device)]
    width = rows.shape[1]
    read = sum(
        (weight[:, at : at + width].square().sum(dim=(0, 2, 3)) for weight, at in readers), rows.new_zeros(width)
    )
    weighted = ((chosen - chosen.mean(dim=0)) * (read.sqrt() + also)).cpu().numpy()
    found: Any = scipy.linalg.qr(weighted, pivoting=True, mode="r")
    return torch.from_numpy(np.sort(found[1][:count]).astype(np.int64)).to(rows.device)


class _Reached(Exception):
    """A layer's inputs are there; what comes after it need not run."""


def _rows(
    small: FlowHead, conv: nn.Conv2d, name: str, step: _Step, kept: dict[str, Tensor]
) -> tuple[Tensor, Tensor, Tensor]:
    """What a layer of the small head reads in a step, patch by patch, what it should give, and how much that counts."""
    read: list[Tensor] = []

    def stop(_module: nn.Module, inputs: tuple[Tensor, ...]) -> None:
        read.append(inputs[0])
        raise _Reached

    hook = conv.register_forward_pre_hook(stop)
    fine_before, coarse_before = small.describe(_feature(step.drive, step.before, step.geometry.here.device))
    fine, coarse = small.describe(_feature(step.drive, step.now, step.geometry.here.device))
    units = kept["hidden"]
    state = step.hidden[:, units], step.cell[:, units], step.velocity
    try:
        small.match(fine, coarse, step.geometry, step.dt_s, fine_before, coarse_before, *state)
    except _Reached:
        pass
    finally:
        hook.remove()
    rows, wanted = _patches(conv, read[0]), _cells(step.gave[name][:, kept[name]] if name in kept else step.gave[name])
    if name in ("tell", "retell"):  # cells that are sure decide the motion
        sure = torch.exp((wanted[:, 2:4].mean(dim=1, keepdim=True) * 4.0).clamp(-6.0, 6.0))
        return rows, wanted, (sure / sure.mean()).clamp(0.05, 4.0)
    return rows, wanted, rows.new_ones(1)


def _sums(pieces: Iterable[tuple[Tensor, Tensor, Tensor]]) -> tuple[Tensor, Tensor]:
    """The weighted normal equations of rows (N, C), to which a one is added, and what they should give (N, D)."""
    normal = right = None
    for rows, wanted, weights in pieces:
        rows = torch.cat([rows, torch.ones_like(rows[:, :1])], dim=1)
        weighted = (rows * weights).T
        normal = weighted @ rows if normal is None else normal + weighted @ rows
        right = weighted @ wanted if right is None else right + weighted @ wanted
    assert normal is not None
    assert right is not None
    return normal.double(), right.double()


def _solve(layer: nn.Conv2d | nn.Linear, normal: Tensor, right: Tensor, ridge: float = RIDGE) -> None:
    found = torch.linalg.solve(
        normal + ridge * normal.diagonal().mean() * torch.eye(len(normal), device=normal.device), right
    )
    layer.weight.copy_(found[:-1].T.reshape(layer.weight.shape))
    assert layer.bias is not None
    layer.bias.copy_(found[-1])


def _main_directions(described: Tensor, count: int) -> Tensor:
    """(count, C) orthonormal, of vectors (B, C, H, W)."""
    return torch.linalg.eigh(torch.cov(described.transpose(0, 1).flatten(1)))[1].flip(1)[:, :count].T


def _patches(conv: nn.Conv2d, inputs: Tensor) -> Tensor:
    """What a convolution's outputs are made of, (N, C * kernel)."""
    found = functional.unfold(inputs, conv.kernel_size, 1, conv.padding, conv.stride)  # type: ignore[arg-type]
    return found.transpose(1, 2).flatten(0, 1)


def _cells(maps: Tensor) -> Tensor:
    """Maps (B, C, H, W) cell by cell, (N, C)."""
    return maps.flatten(2).transpose(1, 2).flatten(0, 1)


def _feature(drive: FeatureDrive, index: int, device: torch.device) -> Tensor:
    return torch.from_numpy(drive.features[index].astype(np.float32))[None].to(device)
