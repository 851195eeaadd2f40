"""One network of a bundle behind a common interface to the engines, and the choice of engine."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from edgemap.runtime.frames.inference import Engine

Tensors = dict[str, NDArray[np.float32]]
Shapes = dict[str, tuple[int, ...]]


@dataclass(frozen=True, slots=True)
class Compute:
    """How a network computes. spin: idle threads busy-wait, which lowers the latency and loads the cores."""

    threads: int = 1
    spin: bool = False
    engine: Engine = "onnxruntime"


@dataclass(frozen=True, slots=True, eq=False)
class Network:
    """An ONNX file, ready to run. inputs, outputs: name to shape, all static. infer: outputs in that order.

    metadata: the file's keys and values, where onnxruntime runs it.
    """

    inputs: Shapes
    outputs: Shapes
    infer: Callable[[Tensors], Sequence[NDArray[np.float32]]]
    metadata: dict[str, str] = field(default_factory=dict)

    def run(self, tensors: Tensors) -> Tensors:
        """Run once: float32 inputs by name to float32 outputs by name."""
        return dict(zip(self.outputs, self.infer(tensors), strict=True))

    def zeros(self) -> Tensors:
        """Input tensors of zeros, to time the network with."""
        return {name: np.zeros(shape, dtype=np.float32) for name, shape in self.inputs.items()}

    def error(self, reference: "Network") -> float:
        """Difference of the outputs from another engine's: the worst output's RMS error over its standard deviation,
        for the same random picture.
        """
        random = np.random.default_rng(0)
        tensors = {name: random.uniform(0, 255.0, shape).astype(np.float32) for name, shape in self.inputs.items()}
        expected, outputs = reference.run(tensors), self.run(tensors)
        return max(float(np.sqrt(np.mean((outputs[k] - v) ** 2)) / (v.std() + 1e-6)) for k, v in expected.items())
