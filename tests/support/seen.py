"""What a detector of a given rate sees of upright cylinders from a pose: boxes, nearer ones hiding farther ones."""

import math

import numpy as np

from edgemap.geometry.camera.floor import FloorCamera
from edgemap.geometry.camera.intrinsics import Intrinsics
from edgemap.geometry.camera.mount import Mount
from edgemap.geometry.observations.detections import Detections

CAMERA = FloorCamera(Intrinsics(640, 480, 400.0, 400.0, 319.5, 239.5), Mount.from_degrees(0.6, 12.0))
HEIGHT_M = 0.7
RADIUS_M = {"chair": 0.25, "potted plant": 0.2, "couch": 0.7, "tv": 0.28, "bed": 0.9, "refrigerator": 0.32}


def box_of(label, x, y, pose, camera=CAMERA):
    """x0 y0 x1 y1 of a thing at (x, y) of the room; None where it is not whole before the camera."""
    turns = np.linspace(0, math.tau, 36)
    radius = RADIUS_M.get(label, 0.3)
    rim = pose.inverse().apply(np.column_stack([x + radius * np.cos(turns), y + radius * np.sin(turns)]))
    points = np.concatenate([np.column_stack([rim, np.full(len(rim), z)]) for z in (0.0, HEIGHT_M)])
    optical, lens = (points - camera.mount.position_base_m()) @ camera.mount.rotation_base_optical(), camera.intrinsics
    if optical[:, 2].min() < 0.1:
        return None
    edges = lens.fx * optical[:, :2] / optical[:, 2:] + (lens.cx + 0.5, lens.cy + 0.5)
    box = np.concatenate([edges.min(axis=0), edges.max(axis=0)])
    return box if box[:2].min() > 0 and (box[2:] < (lens.width, lens.height)).all() else None


def look(room, pose, random, rate=0.8, farthest_m=4.5, noise_px=1.5):
    """Detections of one frame, and the rows of the room that stand whole, near and unhidden before the camera."""
    boxes = [box_of(label, x, y, pose) for label, x, y in room]
    reach = [math.hypot(thing[1] - pose.x_m, thing[2] - pose.y_m) for thing in room]
    found, plain = [], []
    for row, box in enumerate(boxes):
        nearer = [other for other, away in zip(boxes, reach, strict=True) if away < reach[row]]
        if box is None or reach[row] > farthest_m or _hidden(box, nearer):
            continue
        plain.append(row)
        if random.random() < rate:
            found.append((0.8, row, box + random.normal(0.0, noise_px, 4)))
    names = tuple(dict.fromkeys(thing[0] for thing in room))
    if not found:
        return Detections.none(names), plain
    ids = np.array([names.index(room[row][0]) for _, row, _ in found])
    return Detections(np.array([box for _, _, box in found]), np.full(len(found), 0.8), ids, names), plain


def _hidden(box, nearer):
    for other in nearer:
        if other is not None:
            sides = np.minimum(box[2:], other[2:]) - np.maximum(box[:2], other[:2])
            if np.prod(np.maximum(sides, 0.0)) > 0.4 * np.prod(box[2:] - box[:2]):
                return True
    return False
