"""Maps of one drive made in several ways at once: its pictures are read and the backbone runs once for all of them."""

import math
import zlib
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from edgemap.evaluation.grid import FLAT_M, OVERHEAD_M, score_grid
from edgemap.evaluation.objects import TrueObject
from edgemap.evaluation.rooms import TruePlan, score_rooms
from edgemap.geometry.camera.floor import FloorCamera
from edgemap.geometry.grid.occupancy_grid import OccupancyGrid
from edgemap.geometry.map_object import MapObject
from edgemap.geometry.objects.annotations import Annotations
from edgemap.geometry.objects.rooms import rooms_of
from edgemap.runtime.frames.errors import CameraError
from edgemap.runtime.inputs.cameras.pictures import drive_camera
from edgemap.runtime.inputs.drives import Drive
from edgemap.runtime.inputs.drives.truth import read_floor_plan
from edgemap.runtime.network.bundle import Bundle
from edgemap.runtime.network.network import Network, Tensors
from edgemap.runtime.step.config import Config
from edgemap.runtime.step.slam import SemanticSlam, SlamOptions, StepResult, build_slam


def remembering(bundle: Bundle) -> Bundle:
    """The bundle with a backbone that gives its last outputs again for the same picture."""
    reopen = cache(lambda rows: _remembering(bundle.reopen(rows)))
    return replace(bundle, backbone=_remembering(bundle.backbone), reopen=reopen)


def _remembering(network: Network) -> Network:
    last: tuple[int, list[NDArray[np.float32]]] | None = None

    def infer(tensors: Tensors) -> Sequence[NDArray[np.float32]]:
        nonlocal last
        key = zlib.crc32(b"".join(value.tobytes() for value in tensors.values()))
        if last is None or last[0] != key:
            last = key, [value.copy() for value in network.infer(tensors)]
        return last[1]

    return replace(network, infer=infer)


def replayed(
    drive: Drive,
    bundle: Bundle,
    variants: Mapping[str, SlamOptions],
    frames: int | None = None,
    config: Config = Config(),  # noqa: B008 (frozen)
    seen: Callable[[str, StepResult], object] = lambda _name, _result: None,
) -> dict[str, SemanticSlam]:
    """Each variant's front and back end, as `run` makes them, after the drive's first frames; all for None. seen:
    called with every result.

    Raises CameraError for a drive without intrinsics or mount, OdometryError for an odometry that is not available.
    """
    bundle = remembering(bundle)
    with drive_camera(drive, str(drive.folder)) as camera:
        if camera.info.intrinsics is None or camera.info.mount is None:
            raise CameraError(f"{drive.folder}: neither intrinsics nor mount known")
        floor = FloorCamera(camera.info.intrinsics, camera.info.mount)
        slams = {name: build_slam(camera, bundle, floor, how, config) for name, how in variants.items()}
        while (frame := camera.read()) is not None and (frames is None or frame.index < frames):
            for name, slam in slams.items():
                seen(name, slam.step(frame))
    for slam in slams.values():
        slam.finish()
    return slams


def plan_figures(
    objects: Sequence[MapObject],
    annotations: Annotations,
    grid: OccupancyGrid | None,
    drive: Drive,
    frames: int | None = None,
) -> dict[str, Any]:
    """Floor (`grid`), `rooms` and `doors` of a map against the drive's floor plan; empty where it has none. What hangs
    high over the floor, or is flat, is no obstacle. Raises CameraError."""
    plan = read_floor_plan(drive.folder)
    if plan is None or drive.truth is None or drive.intrinsics is None:
        return {}
    standing = [item for item in plan.footprints if item.low_m <= OVERHEAD_M and item.high_m > FLAT_M]
    rooms, doorways, walls, footprints = (
        [np.array(area.corners_m) for area in areas] for areas in (plan.rooms, plan.doorways, plan.walls, standing)
    )
    truth = TruePlan(rooms, [room.kind for room in plan.rooms], doorways, walls, footprints)
    view_rad = 2.0 * math.atan(drive.intrinsics.width / 2.0 / drive.intrinsics.fx)
    mapped = rooms_of(objects, annotations, grid)
    return {"grid": score_grid(grid, truth)} | score_rooms(*mapped, truth, drive.truth.poses[:frames], view_rad)


def true_objects(drive: Drive, frames: int | None = None) -> list[TrueObject]:
    """The drive's objects, each with the number of frames in which it is visible: by boxes.json where there is one."""
    seen = Counter(identity for boxes in drive.boxes[:frames] for identity in boxes.visible_ids())
    return [true_object(item, seen if drive.boxes else None) for item in drive.objects]


def true_object(record: Mapping[str, Any], seen: Mapping[str, int] | None = None) -> TrueObject:
    """A record of objects.json; seen: the number of frames that show each id; None takes the record's."""
    frames = int(record.get("visible_frames") or 0) if seen is None else seen.get(str(record["id"]), 0)
    footprint = tuple((float(x_m), float(y_m)) for x_m, y_m in record.get("footprint_m") or ())
    return TrueObject(record["label"], record["x_m"], record["y_m"], record["on_floor"], frames, footprint)
