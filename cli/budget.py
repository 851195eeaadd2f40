"""`edgemap run --cpu SHARE --temperature C`: doing less where the robot's other programs need the processor."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from edgemap.cli.arguments import arg
from edgemap.cli.errors import OptionError

if TYPE_CHECKING:
    from edgemap.runtime.cameras.around import BudgetedCamera
    from edgemap.runtime.cameras.protocol import Camera

CpuShare = Annotated[
    str | None,
    arg(
        metavar="SHARE",
        help="Processor time to stay within, of one core: 30% or 0.3. Objects are searched for in fewer frames first, "
        "then fewer frames are taken; every frame taken gives a motion. Files are then paced by their stamps. What is "
        "decided stands in run.json and in recordings, and a replay takes it from there.",
    ),
]
Temperature = Annotated[
    float | None,
    arg(metavar="CELSIUS", help="Do less, in the same way, while the hottest thermal zone is above this."),
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


def budgeted(camera: Camera, share: float | None, temperature: float | None, config: Path | None) -> BudgetedCamera:
    """The camera under a budget, or under what a run.json says that one decided. Raises OptionError, ConfigError."""
    from edgemap.runtime.budget import Budget, hottest_c
    from edgemap.runtime.cameras.around import BudgetedCamera
    from edgemap.runtime.config import load_efforts

    if temperature is not None and hottest_c() is None:
        raise OptionError(f"--temperature {temperature:g}: this machine has no /sys/class/thermal/thermal_zone*/temp")
    if share is not None or temperature is not None:
        return BudgetedCamera(camera, Budget(share, temperature))
    return BudgetedCamera(camera, replayed=load_efforts(config) if config else ())
