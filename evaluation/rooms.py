"""Scores of a map's rooms and doors against a floor plan, of what the camera could see of it."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from edgemap.evaluation.objects import pairs_within, share
from edgemap.geometry.arrays import Array
from edgemap.geometry.grid.rooms import Door, Mask, Room, inside
from edgemap.geometry.se2 import SE2

FOUND_IOU = 0.5  # of a mapped room with a true one, which is then found
FOUND_M = 0.5  # between the middles of a mapped door and a true one, which is then found
SEEN_SHARE = 0.5  # of a true room's or doorway's floor: seen less of, it is neither hit nor miss
REACH_M, CELL_M, RAYS, POSES = 4.0, 0.1, 61, 300  # of the view, of the raster, of one view, of a drive
WIDTH_M = 0.6, 1.4  # of a doorway that is a door; a wider one is an opening and counts neither way
KINDS = {"living": "living room", "kitchen": "kitchen", "bedroom": "bedroom", "bathroom": "bathroom"}


@dataclass(frozen=True, slots=True)
class TruePlan:
    """Polygons (K, 2) of a floor plan, map frame, metres. kinds: of the rooms, as floor_plan.json names them. Rooms and
    doorways together are floor, but where a wall or a footprint is."""

    rooms: Sequence[Array]
    kinds: Sequence[str]
    doorways: Sequence[Array]
    walls: Sequence[Array]
    footprints: Sequence[Array] = ()


def score_rooms(
    rooms: Sequence[Room], doors: Sequence[Door], truth: TruePlan, poses: Sequence[SE2], view_rad: float
) -> dict[str, Any]:
    """`rooms`: found (of the true rooms, those that a mapped one covers with an IoU of at least 0.5, one to one),
    mean_iou (of those found), precision (of the mapped rooms), kinds (of those found whose true kind is one that a map
    states, the share with it). `doors`: precision and recall, one to one within 0.5 m. Null where there are none.

    A true room or doorway counts if half of its floor, past walls but not past furniture, lay within 4 m and view_rad
    of one of the poses; others are neither hit nor miss.
    """
    low, points = _raster([*truth.walls, *truth.rooms, *(np.array(room.corners_m) for room in rooms)])
    seen = _seen(low, points, truth.walls, poses, view_rad)
    true, mapped = [inside(p, points) for p in truth.rooms], [inside(room.corners_m, points) for room in rooms]
    counts = np.array([_share(seen, mask) >= SEEN_SHARE for mask in true], np.bool_)
    iou = np.array([[_share(a & b, a | b) for b in mapped] for a in true]).reshape(len(true), len(mapped))
    pairs = pairs_within(1.0 - iou, 1.0 - FOUND_IOU)
    found = [(int(a), int(b)) for a, b in zip(*pairs, strict=True) if counts[a]]
    kinds = [(KINDS.get(truth.kinds[a]), rooms[b].kind) for a, b in found]
    named = [stated == kind for kind, stated in kinds if kind is not None]
    ignored = len(pairs[0]) - len(found)
    return {
        "rooms": {
            "found": share(len(found), int(counts.sum())),
            "mean_iou": round(float(np.mean([iou[pair] for pair in found])), 4) if found else None,
            "precision": share(len(found), len(rooms) - ignored),
            "kinds": share(sum(named), len(named)),
        },
        "doors": _doors(doors, truth.doorways, [_share(seen, inside(d, points)) for d in truth.doorways]),
    }


def _doors(doors: Sequence[Door], doorways: Sequence[Array], shares: Sequence[float]) -> dict[str, float | None]:
    widths = np.array([np.linalg.norm(np.roll(corners, -1, axis=0) - corners, axis=1).max() for corners in doorways])
    wanted = (widths >= WIDTH_M[0]) & (widths <= WIDTH_M[1]) & (np.array(shares) >= SEEN_SHARE)
    away = np.array([[np.linalg.norm(one.centre_m - c.mean(axis=0)) for one in doors] for c in doorways], float)
    matched = wanted[pairs_within(away.reshape(len(doorways), len(doors)), FOUND_M)[0]]
    hits, ignored = int(matched.sum()), int((~matched).sum())
    return {"precision": share(hits, len(doors) - ignored), "recall": share(hits, int(wanted.sum()))}


def _raster(polygons: Sequence[Array]) -> tuple[Array, Array]:
    """Lower corner (2,) and centres (rows, columns, 2) of cells over all polygons."""
    corners = np.concatenate(polygons)
    low = corners.min(axis=0) - CELL_M
    wide, high = np.ceil((corners.max(axis=0) + CELL_M - low) / CELL_M).astype(int).tolist()
    return low, low + (np.stack(np.meshgrid(np.arange(wide), np.arange(high)), axis=-1) + 0.5) * CELL_M


def _seen(low: Array, points: Array, walls: Sequence[Array], poses: Sequence[SE2], view_rad: float) -> Mask:
    """Cells that lay in view of a pose, nearer than the nearest wall."""
    solid, seen = np.zeros(points.shape[:2], np.bool_), np.zeros(points.shape[:2], np.bool_)
    for wall in walls:
        solid |= inside(wall, points)
    steps, turns = np.arange(0.0, REACH_M, CELL_M / 2.0), np.linspace(-0.5, 0.5, RAYS) * view_rad
    for pose in poses[:: 1 + len(poses) // POSES]:
        rays = np.stack([np.cos(pose.yaw_rad + turns), np.sin(pose.yaw_rad + turns)], axis=-1)
        places = np.array([pose.x_m, pose.y_m]) + steps[:, None] * rays[:, None]
        cells = np.floor((places - low) / CELL_M).astype(int)
        columns, rows = cells[..., 0], cells[..., 1]
        within = (cells >= 0).all(axis=-1) & (rows < len(solid)) & (columns < len(solid[0]))
        rows, columns = np.where(within, rows, 0), np.where(within, columns, 0)
        clear = np.logical_and.accumulate(within & ~solid[rows, columns], axis=1)
        seen[rows[clear], columns[clear]] = True
    return seen


def _share(part: Mask, whole: Mask) -> float:
    """Share of a mask that another one covers, 0 of none."""
    return float((part & whole).sum()) / max(int(whole.sum()), 1)
