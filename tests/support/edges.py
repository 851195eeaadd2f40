"""Edges of a room, made from its corners."""

import math

import numpy as np

from edgemap.geometry.camera.mount import up_optical


def room_edges(pitch_deg, roll_deg, rng, count=12, outliers=8):
    """Planes, (N, 3), through a lens and edges of a room along three directions, and others; lengths (N,)."""
    up = up_optical(math.radians(pitch_deg), math.radians(roll_deg))
    away = np.array([0.0, 0.0, 1.0]) - up[2] * up
    away /= np.linalg.norm(away)
    right = np.cross(away, up)
    turn = math.radians(25.0)
    first = math.cos(turn) * right + math.sin(turn) * away
    normals = []
    for direction in (up, first, np.cross(up, first)):
        points = np.column_stack([rng.uniform(-0.6, 0.6, (count, 2)), np.ones(count)])
        normals.append(np.cross(points, direction))
    normals.append(rng.normal(size=(outliers, 3)))
    normals = np.concatenate(normals)
    normals = normals / np.linalg.norm(normals, axis=1, keepdims=True) + rng.normal(0.0, 0.004, normals.shape)
    return normals / np.linalg.norm(normals, axis=1, keepdims=True), rng.uniform(0.08, 0.3, len(normals))
