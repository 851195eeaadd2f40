"""What trials and budgets decided for a run: inputs of the step, recorded with it and taken from there at replay."""

from dataclasses import dataclass

from edgemap.runtime.network import Engine
from edgemap.runtime.precision import Numbers


@dataclass(frozen=True, slots=True)
class Decisions:
    """engine, precision: of the backbone."""

    engine: Engine = "onnxruntime"
    precision: Numbers = "float32"
