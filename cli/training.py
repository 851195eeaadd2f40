"""Options that every `edgemap train` command has, and their checks. No heavy imports here."""

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Literal

from edgemap.cli.arguments import arg
from edgemap.cli.errors import OptionError

Minutes = Annotated[float | None, arg(metavar="M", help="Budget of training time; goes before --epochs or --steps.")]
Resume = Annotated[bool, arg(help="Go on from DIR/last.pt, with the same options as before.")]
Mix = Annotated[
    tuple[float, ...],
    arg(metavar="SHARE...", help="Share of pictures of each --data in turn; by default by how many each holds."),
]
Threads = Annotated[
    int, arg(metavar="N", help="Of the network; one is better than two where other work shares the cores.")
]
Seed = Annotated[int, arg(metavar="N", help="Of order, changes to pictures, and random weights.")]
Bfloat16 = Annotated[bool, arg(help="Convolutions in bfloat16: 1.7 times as fast where the processor has AVX512-BF16.")]
Device = Annotated[
    Literal["cpu", "cuda"], arg(help="Where to compute; `train detector`: with torchrun one GPU for each process.")
]
FeatureCache = Annotated[
    Path | None, arg(metavar="DIR", help="Where features are kept; by default in the user's cache.")
]


def check_training(
    minutes: float | None, rate: float | None, validate_minutes: float | None, mix: Sequence[float] = (), data: int = 0
) -> None:
    """Raises OptionError for budgets and rates of 0 or less, and for a number of shares that differs from that of
    --data.
    """
    for name, value in (("minutes", minutes), ("rate", rate), ("validate-minutes", validate_minutes)):
        if value is not None and not 0.0 < value < 1e6:
            raise OptionError(f"--{name} {value}: must be above 0")
    if mix and (len(mix) != data or min(mix) < 0.0 or sum(mix) <= 0.0):
        raise OptionError(f"--mix {' '.join(map(str, mix))}: expected {data} shares, one for each --data")
