"""Truth of each picture and of the drive: boxes with their visible share, floor labels, objects with footprints."""

from collections.abc import Sequence
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.camera.intrinsics import Intrinsics
from edgemap.geometry.se2 import SE2
from edgemap.runtime.inputs.drives.drive import SEEN_SHARE, SEEN_SIDE_PX
from edgemap.runtime.inputs.drives.truth import FloorLabel
from edgemap.simulation.apartment.apartment import Apartment
from edgemap.simulation.apartment.layout import ALIVE
from edgemap.simulation.render.movers import Mover
from edgemap.simulation.render.renderer import RenderedFrame, Renderer
from edgemap.simulation.render.scene import ROOM_ID
from edgemap.simulation.render.view import View

_SMALLEST_PX = 40


def picture_boxes(
    renderer: Renderer, frame: RenderedFrame, view: View, apartment: Apartment, movers: Sequence[Mover] = ()
) -> list[dict[str, Any]]:
    """Labelled objects and movers in a frame: `id`, `label`, `box` round the visible pixels, `full_box` round the whole
    object as if nothing hid it, `visible` share 0..1.

    Boxes are (x0, y0, x1, y1) with pixel k covering k to k + 1, cut by the picture's border. The share is of the
    object's whole silhouette, so both what hides it and the border lower it.
    """
    ids = frame.ids
    labels = {item.id: item.label for item in apartment.furniture if item.label}
    labels |= {mover.id: "person" for mover in movers}
    counts = np.bincount(ids.ravel())
    seen = [id_ for id_ in labels if id_ < len(counts) and counts[id_] >= _SMALLEST_PX]
    visible_px = renderer.visible_px(ids)
    full_boxes, whole_px = renderer.whole(view, seen, movers)
    records = []
    for id_, full, whole in zip(seen, full_boxes, whole_px, strict=True):
        x, y, width, height = cv2.boundingRect((ids == id_).view(np.uint8))
        box = [x, y, x + width, y + height]
        # The whole box is drawn between pixels, the visible one round them: neither may miss what the other has.
        low, high = np.minimum(np.floor(full[:2] + 0.5), box[:2]), np.maximum(np.floor(full[2:] + 0.5), box[2:])
        share = min(1.0, visible_px[id_] / max(float(whole), 1e-9))
        records.append(
            {
                "id": id_,
                "label": labels[id_],
                "box": box,
                "full_box": [int(side) for side in (*low, *high)],
                "visible": round(float(share), 3),
            }
        )
    return records


def is_visible(record: dict[str, Any], side_px: float = SEEN_SIDE_PX, share: float = SEEN_SHARE) -> bool:
    """Whether a box record counts as a sighting: large and visible enough."""
    x0, y0, x1, y1 = record["box"]
    return max(x1 - x0, y1 - y0) >= side_px and record["visible"] >= share


def object_records(
    apartment: Apartment, pose_home_map: SE2, boxes: Sequence[Sequence[dict[str, Any]]]
) -> list[dict[str, Any]]:
    """One record per labelled object, in the map frame: position of the footprint's centre, footprint, size in metres,
    and the number of pictures in which it is visible. People and pets have boxes, but are not objects of the map."""
    pose_map_home = pose_home_map.inverse()
    seen = [record["id"] for frame in boxes for record in frame if is_visible(record)]
    records = []
    for item in apartment.furniture:
        if not item.label or item.label in ALIVE:
            continue
        centre = pose_map_home.apply(item.middle_home_m)
        footprint = pose_map_home.apply(item.footprint_home_m())
        records.append(
            {
                "id": item.id,
                "label": item.label,
                "x_m": _rounded(centre[0]),
                "y_m": _rounded(centre[1]),
                "on_floor": item.on_floor,
                "footprint_m": [[_rounded(x), _rounded(y)] for x, y in footprint],
                "width_m": _rounded(item.model.width_m),
                "depth_m": _rounded(item.model.depth_m),
                "height_m": _rounded(item.model.height_m),
                "visible_frames": seen.count(item.id),
            }
        )
    return records


def _rounded(value: NDArray[np.float64] | float) -> float:
    return round(float(value), 4)


RUG_M = 0.025  # thickest that is floor
BELOW_CEILING_M = 0.05


def floor_labels(frame: RenderedFrame, view: View, lens: Intrinsics, ceiling_m: float) -> NDArray[np.uint8]:
    """Labels (H, W): 1 floor and rugs, 2 walls with their doors and frames, 0 furniture, people and ceiling."""
    rows, columns = frame.ids.shape
    v, u = np.mgrid[0:rows, 0:columns]
    rays = lens.rays(np.column_stack([u.ravel(), v.ravel()]))
    up = (rays @ view.rotation_home_optical.T)[:, 2].reshape(rows, columns)
    height_m = view.position_home_m[2] + up * frame.depth_m
    upper = np.where(height_m < ceiling_m - BELOW_CEILING_M, FloorLabel.WALL, FloorLabel.OTHER)
    labels = np.where(height_m < RUG_M, FloorLabel.FLOOR, upper)
    return np.where(frame.ids == ROOM_ID, labels, FloorLabel.OTHER).astype(np.uint8)
