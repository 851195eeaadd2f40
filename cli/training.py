"""What every `edgemap train` command has besides its settings. No heavy imports here."""

from pathlib import Path
from typing import Annotated

from edgemap.cli.arguments import arg
from edgemap.cli.options import above_zero, at_least
from edgemap.export.settings import Settings
from edgemap.runtime.frames.errors import UsageError

TORCH = ("torch", "onnx")  # what training needs of the extra `export`
Resume = Annotated[bool, arg(help="Go on from DIR/last.pt, with the same options as before.")]
FeatureCache = Annotated[
    Path | None, arg(metavar="DIR", help="Where features are kept; by default in the user's cache.")
]


def check_training(settings: Settings, data: int) -> None:
    """Raises UsageError for budgets and rates of 0 or less, and for a number of shares that differs from that of
    --data.
    """
    values = vars(settings)
    counts = {name: values.get(name) for name in ("batch", "threads", "epochs")}
    at_least(1, **counts)
    above_zero(**{name: values[name] for name in ("minutes", "rate", "validate_minutes")})
    mix = values.get("mix", ())
    if mix and (len(mix) != data or min(mix) < 0.0 or sum(mix) <= 0.0):
        raise UsageError(f"--mix {' '.join(map(str, mix))}: expected {data} shares, one for each --data")
