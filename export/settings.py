"""Settings of the trainings: the options of `edgemap train` as the trainers receive them. No heavy imports."""

from dataclasses import dataclass
from typing import Annotated, Any, Literal

import tyro


def _default(value: str) -> str:
    return "" if value in ("None", "True", "False") else f"(default: {value})"


def _arg(**options: Any) -> Any:
    """As `edgemap.cli.arguments.arg`, which this package may not import."""
    return tyro.conf.arg(help_behavior_hint=_default, **options)


Bfloat16 = Annotated[
    bool, _arg(help="Convolutions in bfloat16: 1.7 times as fast where the processor has AVX512-BF16.")
]
Device = Annotated[
    Literal["cpu", "cuda"], _arg(help="Where to compute; `train detector`: with torchrun one GPU for each process.")
]
Epochs = Annotated[int, _arg(metavar="N", help="Budget in passes over the data.")]
Mix = Annotated[
    tuple[float, ...],
    _arg(metavar="SHARE...", help="Share of pictures of each --data in turn; by default by how many each holds."),
]
Rate = Annotated[float, _arg(metavar="RATE", help="Highest learning rate.")]


@dataclass(frozen=True, kw_only=True)
class Settings:
    """Budget, steps and validation."""

    minutes: Annotated[
        float | None, _arg(metavar="M", help="Budget of training time; goes before --epochs or --steps.")
    ] = None
    batch: Annotated[int, _arg(metavar="N", help="Pictures, views or clips per step.")] = 16
    seed: Annotated[int, _arg(metavar="N", help="Of order, changes to pictures, and random weights.")] = 0
    validate_minutes: Annotated[
        float | None,
        _arg(
            metavar="M",
            help="Training time between validations; by default a detector has one after every epoch, a floor head one "
            "at the end.",
        ),
    ] = None
    threads: Annotated[
        int, _arg(metavar="N", help="Of the network; one is better than two where other work shares the cores.")
    ] = 2
    device: Annotated[Literal["cpu", "cuda"], tyro.conf.Suppress] = "cpu"


@dataclass(frozen=True, kw_only=True)
class DetectorSettings(Settings):
    """Budget, steps and validation."""

    epochs: Epochs = 10
    rate: Rate = 3e-4
    size: Annotated[
        int | None,
        _arg(
            name="input",
            metavar="PX",
            help="Largest side of the square training pictures, a multiple of 32; by default the bundle's.",
        ),
    ] = None
    mix: Mix = ()
    keep: Annotated[
        float,
        _arg(name="keep-weight", metavar="W", help="How hard to hold on to scores and boxes of the reference network."),
    ] = 1.0
    mosaic: Annotated[float, tyro.conf.Suppress] = 0.5  # share of pictures that are made of four
    bfloat16: Bfloat16 = False
    device: Device = "cpu"


@dataclass(frozen=True, kw_only=True)
class FloorSettings(Settings):
    """Budget, steps and validation."""

    epochs: Epochs = 10
    rate: Rate = 3e-3
    mix: Mix = ()
    threads: Annotated[int, _arg(metavar="N", help="Of the network.")] = 1


@dataclass(frozen=True, kw_only=True)
class OdometrySettings(Settings):
    """Budget, steps and validation."""

    steps: Annotated[int, _arg(metavar="N", help="Budget in batches.")] = 4000
    batch: Annotated[int, _arg(metavar="N", help="Clips per step.")] = 6
    rate: Rate = 5e-3
    validate_minutes: Annotated[float | None, _arg(metavar="M", help="Training time between validations.")] = 5.0
    bfloat16: Bfloat16 = False
    device: Device = "cpu"
