"""Engine and number format of a backbone: recorded with a run, and taken from there at replay."""

from dataclasses import dataclass
from typing import Literal

Engine = Literal["onnxruntime", "openvino"]
Precision = Literal["float32", "int8"]


@dataclass(frozen=True, slots=True)
class Inference:
    """What computes a backbone: an input of the step, as its outputs differ in the last digits."""

    engine: Engine = "onnxruntime"
    precision: Precision = "float32"
