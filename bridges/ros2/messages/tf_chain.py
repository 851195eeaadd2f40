"""What tf says of a base in a map: the frames between both, and corrections of the map, which move earlier poses."""

from collections.abc import Mapping

import numpy as np
from scipy.spatial.transform import Rotation

from edgemap.geometry.arrays import Array
from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.errors import CameraError
from edgemap.runtime.frames.reading import one_line

MAP, BASES = "map", ("base_footprint", "base_link")  # REP 105 and 120
SAME = 1e-6  # m and rad; a correction that is smaller is none


class TfFrames:
    """The frames of `MAP,BASE`; empty for the usual names. where: for messages."""

    def __init__(self, text: str, where: str) -> None:
        names = [name.strip().lstrip("/") for name in text.split(",")] if text else []
        self.top, self.bases = (names[0] or MAP if names else MAP), (names[1:] or list(BASES))
        self._where = where

    def chain(self, parents: Mapping[str, str]) -> list[str]:
        """The frames from below the map's down to the base. parents: by frame. Raises CameraError where they are not
        joined."""
        for base in self.bases:
            chain: list[str] = []
            while base in parents and base not in chain:
                chain.append(base)
                base = parents[base]
                if base == self.top:
                    return chain[::-1]
        known = ", ".join(sorted({*parents, *parents.values()})[:12]) or "none"
        raise CameraError(
            f"{self._where}: tf does not join {one_line(self.top)} to {' or '.join(map(one_line, self.bases))} (its "
            f"frames: {known}); --odometry tf:MAP,BASE names others"
        )


class Corrections:
    """Spreads each correction of the map over the path before it: as far back as the mean drift, all corrections so far
    over all path so far, makes such an error. Each step of that path turns by its share; what is then left of the error
    of the last place is spread likewise, as a pose graph of odometry does with one loop."""

    def __init__(self) -> None:
        self._sum_m = 0.0

    def spread(self, poses: Array, path_m: Array, moved: Array) -> None:
        """Moves poses (N, 4, 4) in place, the last of them by all of a correction (4, 4). path_m: travelled up to each,
        (N,)."""
        size_m = size_of(moved, poses[-1])
        self._sum_m += size_m
        first = int(np.searchsorted(path_m, path_m[-1] * (1.0 - size_m / max(self._sum_m, SAME))))
        past, since_m = poses[first:], path_m[first:] - path_m[first]
        shares = (since_m / since_m[-1] if since_m[-1] > SAME else np.ones(len(since_m)))[:, None]
        turn, end_m = Rotation.from_matrix(moved[:3, :3]).as_rotvec(), (moved @ past[-1])[:3, 3]
        half = shares - np.diff(shares, axis=0, prepend=shares[:1]) / 2.0
        steps_m = np.diff(past[:, :3, 3], axis=0, prepend=past[:1, :3, 3])
        places_m = past[0, :3, 3] + np.cumsum(Rotation.from_rotvec(half * turn).apply(steps_m), axis=0)
        past[:, :3, 3] = places_m + shares * (end_m - places_m[-1])
        past[:, :3, :3] = Rotation.from_rotvec(shares * turn).as_matrix() @ past[:, :3, :3]


def planar_of(pose: Array) -> SE2:
    """A pose (4, 4) on the floor."""
    return SE2(float(pose[0, 3]), float(pose[1, 3]), float(np.arctan2(pose[1, 0], pose[0, 0])))


def size_of(moved: Array, pose: Array) -> float:
    """How far a correction moves a robot, a radian counting as a metre."""
    shift = (moved @ pose)[:2, 3] - pose[:2, 3]
    return float(np.hypot(*shift) + abs(np.arctan2(moved[1, 0], moved[0, 0])))
