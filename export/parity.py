"""Proof that a bundle computes what its source computes: random pictures, random states, a chain of steps."""

from collections.abc import Callable

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from edgemap.export.errors import ExportError
from edgemap.export.odometry.paper import PaperHead
from edgemap.runtime.network.bundle import Bundle
from edgemap.runtime.network.manifest import InputSpec, Parity
from edgemap.runtime.network.network import Tensors

STEPS = 8
CASES = 2
# Two float32 implementations sum in different orders. Over 75 convolutions that costs some 1e-5 of an output's largest
# value; a wrong padding, activation or channel order costs more than 1e-2.
RELATIVE_TOLERANCE = 1e-4
# The head's chain carries the backbone's rounding through its states: measured up to 4e-5 with YOLOv3's 13x13x255. A
# gate in the wrong place costs more than 1e-1.
CHAIN_TOLERANCE = 5e-4

# A reference backbone: the network's input (1, 3, H, W) to its outputs by name.
Array32 = NDArray[np.float32]
Reference = Callable[[Array32], Tensors]


class Comparison:
    """The largest difference of a file's outputs from their source's, and the tolerance of that output."""

    def __init__(self, file: str) -> None:
        self.file, self.worst = file, Parity(max_abs_difference=0.0, tolerance=0.0, steps=STEPS, cases=CASES)

    def check(self, name: str, expected: Array32, found: Array32, relative: float, when: str) -> None:
        """Compare one output. relative: tolerance, of its largest absolute value. Raises ExportError."""
        if expected.shape != found.shape:
            raise ExportError(f"{self.file}: {name} has shape {found.shape}, its source gives {expected.shape}")
        if not (np.isfinite(expected).all() and np.isfinite(found).all()):
            raise ExportError(f"{self.file}: {name} is not finite ({when})")
        scale = max(float(np.abs(expected).max(initial=0.0)), 1e-6)
        difference = float(np.abs(expected.astype(np.float64) - found).max(initial=0.0))
        if difference > relative * scale:
            raise ExportError(
                f"{self.file}: parity failed: {name} differs by {difference:.3g} ({when}); "
                f"tolerance {relative * scale:.3g}, its values reach {scale:.3g}"
            )
        if difference >= self.worst.max_abs_difference:
            self.worst.max_abs_difference, self.worst.tolerance = difference, relative * scale


def random_picture(generator: np.random.Generator, height: int, width: int) -> NDArray[np.float32]:
    """A picture of coloured blocks under noise, (1, 3, height, width), whole values 0..255."""
    blocks = generator.integers(0, 256, (1, 3, (height + 31) // 32, (width + 31) // 32))
    coarse = np.repeat(np.repeat(blocks, 32, axis=2), 32, axis=3)[:, :, :height, :width]
    noise = generator.integers(-60, 61, coarse.shape)
    return np.clip(coarse + noise, 0, 255).astype(np.float32)


def network_input(picture: NDArray[np.float32], spec: InputSpec) -> NDArray[np.float32]:
    """A picture 0..255 as a network takes it: at other values PicoDet's float32 rounds 50 times as coarsely."""
    mean, std = (np.array(values, dtype=np.float32)[:, None, None] for values in (spec.mean, spec.std))
    return (picture * np.float32(spec.scale) - mean) / std


def prove(bundle: Bundle, reference: Reference, head: PaperHead | None, exact: bool = False) -> dict[str, Parity]:
    """Run source and bundle side by side; a Parity per file, relative tolerance 1e-4 for the backbone, 5e-4 for a head.

    Each of 2 cases is a chain of 8 steps: a fresh random picture per step, random states at the start, each side fed
    with its own features and its own states, every output of every step and the final state compared. exact: the
    backbone's outputs must be equal bit for bit (an adopted file), but for the floor mask. Raises ExportError.
    """
    detector, spec = bundle.manifest.detector, bundle.manifest.detector.input
    floor = detector.floor and detector.floor.name
    backbone, chain = Comparison(detector.file), head and _Chain(bundle, head)
    for case in range(CASES):
        generator = np.random.default_rng(case)
        if chain:
            chain.start(generator)
        for step in range(STEPS):
            picture = network_input(random_picture(generator, spec.height, spec.width), spec)
            when = f"case {case}, step {step}"
            expected, found = reference(picture), bundle.backbone.run({spec.name: picture})
            for name, tensor in expected.items():
                relative = 0.0 if exact and name != floor else RELATIVE_TOLERANCE
                backbone.check(name, tensor, found[name], relative, when)
            if chain:
                feature = chain.record.feature
                chain.step(expected.get(feature, found[feature]), found[feature], when)
    parts = (backbone, chain.comparison) if chain else (backbone,)
    return {part.file: part.worst for part in parts}


class _Chain:
    """The head's recurrent run on both sides."""

    def __init__(self, bundle: Bundle, head: PaperHead) -> None:
        self.record, self._network = bundle.odometry_head("paper")
        self._head, self.comparison = head.eval(), Comparison(self.record.file)

    def start(self, generator: np.random.Generator) -> None:
        states = [generator.standard_normal(state.shape).astype(np.float32) for state in self.record.states]
        self._theirs: list[Tensor] = [torch.from_numpy(state) for state in states]
        self._ours = {state.input: values for state, values in zip(self.record.states, states, strict=True)}

    def step(self, expected: Array32, found: Array32, when: str) -> None:
        with torch.no_grad():
            motion, *self._theirs = self._head(torch.from_numpy(expected), *self._theirs)
        outputs = self._network.run({self.record.feature_input: found, **self._ours})
        names = (self.record.motion, *(state.output for state in self.record.states))
        for name, tensor in zip(names, (motion, *self._theirs), strict=True):
            self.comparison.check(name, tensor.numpy(), outputs[name], CHAIN_TOLERANCE, when)
        self._ours = {state.input: outputs[state.output] for state in self.record.states}
