"""One network of a bundle, whichever engine runs it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Tensors = dict[str, NDArray[np.float32]]
Shapes = dict[str, tuple[int, ...]]


@dataclass(frozen=True, slots=True)
class Compute:
    """How a network computes. spin: idle threads wait in circles, which answers sooner and burns the cores."""

    threads: int = 1
    spin: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class Network:
    """An ONNX file, ready to run. inputs, outputs: name to shape, all static. infer: outputs in that order."""

    inputs: Shapes
    outputs: Shapes
    infer: Callable[[Tensors], Sequence[NDArray[np.float32]]]

    def run(self, tensors: Tensors) -> Tensors:
        """Run once: float32 inputs by name to float32 outputs by name."""
        return dict(zip(self.outputs, self.infer(tensors), strict=True))

    def zeros(self) -> Tensors:
        """Inputs to try it with."""
        return {name: np.zeros(shape, dtype=np.float32) for name, shape in self.inputs.items()}
