"""Rooms of labelled points, and the maps that a drive would make of them."""

import json

import numpy as np

from edgemap.geometry.grid.occupancy_grid import OccupancyGrid
from edgemap.geometry.map_object import MapObject
from edgemap.geometry.se2 import SE2


def content_of(path):
    """What a map.json or a folder's holds, without what tells two runs apart."""
    document = json.loads((path if path.is_file() else path / "map.json").read_text())
    return {name: value for name, value in document.items() if name not in ("map_id", "saved_at")}


LABELS = ["chair", "potted plant", "couch", "tv", "bed", "dining table", "refrigerator"]
SHARES = np.array([6, 3, 2, 1, 1, 1, 1]) / 15.0


def somewhere(random, reach_m=5.0):
    """Any pose within reach."""
    x_m, y_m = random.uniform(-reach_m, reach_m, 2)
    return SE2(x_m, y_m, random.uniform(-3.0, 3.0))


def furnished(random, count, size_m=(8.0, 6.0), apart_m=0.6):
    """That many things as (label, x_m, y_m), none nearer to another than `apart_m`."""
    room = []
    while len(room) < count:
        x, y = random.uniform((0, 0), size_m)
        if all(np.hypot(x - other[1], y - other[2]) > apart_m for other in room):
            room.append((str(random.choice(LABELS, p=SHARES)), float(x), float(y)))
    return room


def mapped(room, pose_room_map=None, random=None, sigma_m=0.0, missed=0.0, false=0, told_sigma_m=0.12):
    """A map of the room, in its own frame: noise, a share of the things missed, some made up, in random order."""
    pose = pose_room_map or SE2()
    things = list(room)
    if random is not None:
        things = [thing for thing in things if random.random() >= missed]
        things += furnished(random, false)
        random.shuffle(things)
    objects, numbers = [], {}
    for label, x, y in things:
        place = pose.inverse().apply([x, y])
        if random is not None:
            place = place + random.normal(0.0, sigma_m, 2)
        numbers[label] = numbers.get(label, 0) + 1
        identity, own = f"{label}-{numbers[label]}", np.eye(2) * told_sigma_m**2
        objects.append(MapObject(identity, label, place, own, 0.5, 0.9, 10, 0.9, 1.0, 2.0))
    return objects


ROOM = furnished(np.random.default_rng(11), 16, apart_m=0.8)
ROOMS = [((0, 0), (4, 3)), ((4, 1), (7, 3)), ((1, 3), (3, 5.5))]  # of a floor: lower and upper corner, metres
PAIRS = [("chair", 0.6, 0.5), ("potted plant", 3.4, 0.5), ("chair", 6.5, 1.5), ("potted plant", 6.5, 4.3)]


def two_rooms(door_m: float, cut: int = 0) -> OccupancyGrid:
    """Two rooms of 3 x 4 m side by side along x, a wall of 10 cm with a door in its middle; the first `cut` columns
    were not seen."""
    odds = np.full((84, 126), 40, np.int8)
    odds[2:82, 2:62] = odds[2:82, 64:124] = -40
    half = round(door_m / 0.1)
    odds[42 - half : 42 + half, 62:64] = -40
    odds[:, :cut] = 0
    return OccupancyGrid(odds, -1.0, 2.0, 0.05)


def floor(rooms, pose=None, cut_m=9.0):
    """The grid of a floor as far as x, in the frame of a map at a pose: 3 cm samples, occupied round each room."""
    axes = [np.arange(-2.5, 8.0, 0.03)] * 2
    points = np.stack(np.meshgrid(*axes), axis=-1)
    away = np.min([np.maximum(low - points, points - high).max(-1) for low, high in np.array(rooms, float)], axis=0)
    places = (pose or SE2()).inverse().apply(points.reshape(-1, 2)).reshape(points.shape)
    cells = np.floor((places - places.min(axis=(0, 1))) / 0.05).astype(int)
    log_odds = np.zeros(cells.max(axis=(0, 1))[::-1] + 1, np.int8)
    for chosen, value in (((away > 0) & (away < 0.08), 40), (away < 0, -40)):
        x, y = cells[chosen & (points[..., 0] < cut_m)].T
        log_odds[y, x] = value
    x_m, y_m = places.min(axis=(0, 1)).tolist()
    return OccupancyGrid(log_odds, x_m, y_m, 0.05)
