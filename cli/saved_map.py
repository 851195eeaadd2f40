"""`edgemap run --map SAVED [--start X,Y,YAW_DEG]`: going on with a saved map."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from edgemap.cli.options import OptionError, numbers

if TYPE_CHECKING:
    from edgemap.geometry.camera.floor import FloorCamera
    from edgemap.geometry.objects.forgetting import Forgetter, NoForgetting
    from edgemap.runtime.loop import Steps
    from edgemap.runtime.pipeline import Pipeline

SavedMap = Annotated[
    Path | None,
    tyro.conf.arg(
        name="map",
        metavar="SAVED",
        help="Go on with a saved map (map.json or run folder): its objects keep their ids. Where in it the robot is, "
        "is found by its objects once enough of them are seen, or told by --start.",
    ),
]
StartText = Annotated[
    str | None,
    tyro.conf.arg(
        metavar="X,Y,YAW_DEG",
        help="Where the robot starts in the saved map, to about 0.1 m and 3 degrees: metres forward and left, degrees "
        "counter-clockwise.",
    ),
]
Forget = Annotated[
    Literal["auto", "on", "off"],
    tyro.conf.arg(
        help="Whether an object that is in plain view and not detected, look after look, leaves the map; auto: on with "
        "--map, where furniture may have been moved since."
    ),
]


def forgetter_of(forget: str, saved: Path | None, clustering: str, floor: FloorCamera) -> Forgetter | NoForgetting:
    """What the run weighs negative evidence with. Raises OptionError for a map that cannot forget."""
    from edgemap.geometry.objects.forgetting import Forgetter, NoForgetting

    if forget == "on" and clustering == "paper":
        raise OptionError("--forget on: the paper's clustering keeps every sighting for good")
    return Forgetter(floor) if forget == "on" or (forget == "auto" and saved is not None) else NoForgetting()


def in_saved_map(pipeline: Pipeline, saved: Path | None, start: str | None, clustering: str) -> Steps:
    """The pipeline as it is without a saved map; else one that goes on with it. Raises OptionError or MapError."""
    from math import radians

    from edgemap.geometry.objects.map_object import load_map
    from edgemap.geometry.se2 import SE2
    from edgemap.runtime.relocalisation import Relocaliser, start_in

    if saved is None:
        if start is not None:
            raise OptionError(f"--start {start}: a start pose is one in a saved map, give that with --map")
        return pipeline
    if clustering == "paper":
        raise OptionError("--map goes on by association: the paper's clustering needs every sighting, not their map")
    objects = load_map(saved)
    if start is None:
        return Relocaliser(pipeline, objects)
    x_m, y_m, yaw_deg = numbers(start, "--start", "X,Y,YAW_DEG")
    return start_in(pipeline, objects, SE2(x_m, y_m, radians(yaw_deg)))


def where_it_was(steps: Steps, saved: Path | None) -> str | None:
    """How the search for the robot's place in the saved map ended, in one line; None where there was none."""
    from math import degrees

    from edgemap.runtime.relocalisation import Relocaliser

    if not isinstance(steps, Relocaliser):
        return None
    if steps.alignment is None:
        return f"not found in {saved}, so this map stands alone in its own frame: {steps.reason}"
    pose = steps.alignment.pose_a_b
    return (
        f"found in {saved} by {len(steps.alignment.pairs)} objects: the start was at x {pose.x_m:.2f} m, "
        f"y {pose.y_m:.2f} m, yaw {degrees(pose.yaw_rad):.1f} deg"
    )
