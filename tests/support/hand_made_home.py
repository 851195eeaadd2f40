"""A home written down by hand, two rooms and a doorway, for tests that need no furniture library."""

from types import SimpleNamespace

import numpy as np

from edgemap.geometry.se2 import SE2

# label, x, y, width, depth, height, yaw
PIECES = (
    ("couch", 2.0, 0.55, 2.0, 0.9, 0.8, np.pi / 2),
    ("chair", 0.6, 3.0, 0.8, 0.8, 0.9, 0.0),
    ("dining table", 4.2, 3.0, 1.4, 0.9, 0.75, 0.0),
    ("chair", 3.4, 3.0, 0.45, 0.45, 0.9, 0.0),
    ("chair", 5.0, 3.0, 0.45, 0.45, 0.9, np.pi),
    ("potted plant", 0.4, 4.5, 0.4, 0.4, 1.2, 0.0),
    ("refrigerator", 5.6, 4.5, 0.6, 0.6, 1.8, np.pi),
    ("bed", 8.2, 1.2, 1.6, 2.0, 0.6, np.pi),
    ("potted plant", 9.6, 4.5, 0.4, 0.4, 1.0, 0.0),
    ("", 9.5, 3.0, 0.6, 0.5, 2.0, np.pi),
)
WALLS = ((0, 0, 10, 0.1), (0, 0, 0.1, 5), (9.9, 0, 10, 5), (0, 4.9, 10, 5), (6, 0, 6.1, 2.3), (6, 3.3, 6.1, 5))


def piece(number, label, x, y, width, depth, height, yaw, z=0.0):
    model = SimpleNamespace(width_m=width, depth_m=depth, height_m=height)
    return SimpleNamespace(
        id=number, label=label, model=model, pose_home_object=SE2(x, y, yaw), z_m=z, on_floor=z < 0.02
    )


def home(pieces=PIECES, walls=WALLS, width_m=10.0, depth_m=5.0):
    plan = SimpleNamespace(width_m=width_m, depth_m=depth_m, height_m=2.5, walls=walls, rooms=(None, None))
    return SimpleNamespace(plan=plan, furniture=tuple(piece(i, *row) for i, row in enumerate(pieces, start=1)))
