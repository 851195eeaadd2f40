"""Decisions of trials for a run (engine, precision): recorded with it, and reused at replay."""

from dataclasses import dataclass
from typing import Literal

Engine = Literal["onnxruntime", "openvino", "openvino-bf16"]
Numbers = Literal["float32", "int8"]
Precision = Numbers | Literal["auto"]


@dataclass(frozen=True, slots=True)
class Decisions:
    """What trials decided for a run: an input of the step, recorded with it and taken from there at replay. engine,
    precision: of the backbone."""

    engine: Engine = "onnxruntime"
    precision: Numbers = "float32"
