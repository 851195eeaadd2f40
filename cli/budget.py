"""`edgemap run --cpu SHARE`: doing less where the robot's other programs need the processor."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from edgemap.cli.arguments import arg
from edgemap.cli.errors import OptionError

if TYPE_CHECKING:
    from edgemap.runtime.inputs.cameras.base import BudgetedCamera
    from edgemap.runtime.inputs.cameras.protocol import Camera

CpuShare = Annotated[
    str | None,
    arg(
        metavar="SHARE",
        help="Processor time to stay within, of one core: 30% or 0.3. Objects are searched for in fewer frames first, "
        "then fewer frames are taken; every frame taken gives a motion. Files are then paced by their stamps. What is "
        "decided stands in run.json and in recordings, and a replay takes it from there.",
    ),
]


def read_share(text: str | None) -> float | None:
    """`30%` or `0.3` as a share of one core. Raises OptionError."""
    if text is None:
        return None
    try:
        share = float(text.removesuffix("%")) / (100.0 if text.endswith("%") else 1.0)
    except ValueError:
        share = -1.0
    if not 0.01 <= share <= 64.0 or (share >= 10.0 and not text.endswith("%")):
        raise OptionError(f"--cpu {text}: expected a share of one core, 30% or 0.3")
    return share


def budgeted(camera: "Camera", share: float | None, config: Path | None) -> "BudgetedCamera":
    """The camera under a budget, or under the budget's decisions recorded in a run.json. Raises ConfigError."""
    from edgemap.runtime.inputs.budget import Budget
    from edgemap.runtime.inputs.cameras.base import BudgetedCamera
    from edgemap.runtime.step.config import load_efforts

    if share is not None:
        return BudgetedCamera(camera, Budget(share))
    return BudgetedCamera(camera, replayed=load_efforts(config) if config else ())
