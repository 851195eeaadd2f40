"""Candidate motions between two maps, from every two objects whose labels and mutual distance agree."""

from collections.abc import Generator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.arrays import CHI2_997, Array
from edgemap.geometry.map_object import MapObject
from edgemap.geometry.se2 import SE2, wrap_angles

SHORTEST_M = 0.7  # nearer objects constrain the rotation too little
SAME_PLACE_M, SAME_TURN_RAD = 0.4, 0.2  # motions that differ by less are one
CHUNK = 200_000  # distances between objects, of all motions scored in one unit of work


@dataclass(frozen=True, slots=True, eq=False)
class Places:
    """The objects of a map: positions_m (N, 2), covariances_m2 (N, 2, 2), and labels (N,)."""

    positions_m: Array
    covariances_m2: Array
    labels: NDArray[np.str_]

    @classmethod
    def of(cls, objects: Sequence[MapObject]) -> "Places":
        """As arrays."""
        positions_m = np.array([item.position_m for item in objects], dtype=np.float64).reshape(-1, 2)
        covariances_m2 = np.array([item.covariance_m2 for item in objects], dtype=np.float64).reshape(-1, 2, 2)
        return cls(positions_m, covariances_m2, np.array([item.label for item in objects], dtype=np.str_))

    @property
    def variances_m2(self) -> Array:
        """Mean variance over directions of each object, (N,)."""
        return np.trace(self.covariances_m2, axis1=1, axis2=2) / 2.0


class Motions(NamedTuple):
    """N motions: yaw_rad (N,), and the places to which they take the midpoint of the two objects they come from.

    middle_a_m, middle_b_m: (N, 2) that midpoint in both maps. place_m2: (N,) variance there; turn_rad2: (N,).
    """

    yaw_rad: Array
    middle_a_m: Array
    middle_b_m: Array
    place_m2: Array
    turn_rad2: Array

    def apply(self, points_b_m: Array) -> Array:
        """Points (K, 2) of the second map in the first one's frame, by each motion: (N, K, 2)."""
        c, s = np.cos(self.yaw_rad)[:, None], np.sin(self.yaw_rad)[:, None]
        x, y = np.moveaxis(points_b_m[None] - self.middle_b_m[:, None], -1, 0)
        return np.stack([c * x - s * y, s * x + c * y], axis=-1) + self.middle_a_m[:, None]

    def pose(self, row: int) -> SE2:
        """Pose of the second map in the first, of the motion at an index."""
        rotation = SE2(0.0, 0.0, float(self.yaw_rad[row]))
        x_m, y_m = self.middle_a_m[row] - rotation.apply(self.middle_b_m[row])
        return SE2(x_m, y_m, rotation.yaw_rad)


def hypotheses(first: Places, second: Places) -> Motions:
    """All motions by two label-consistent correspondences whose lengths agree within the gate; never a mirror image."""
    i, j = _correspondences(first, second)
    a, b, var_a, var_b = first.positions_m, second.positions_m, first.variances_m2, second.variances_m2
    p, q = np.triu_indices(len(i), 1)
    along_a, along_b = a[i[q]] - a[i[p]], b[j[q]] - b[j[p]]
    length_a, length_b = np.linalg.norm(along_a, axis=1), np.linalg.norm(along_b, axis=1)
    ends_m2 = var_a[i[p]] + var_a[i[q]] + var_b[j[p]] + var_b[j[q]]
    fits = (length_a - length_b) ** 2 <= CHI2_997 * ends_m2
    fits &= (i[p] != i[q]) & (j[p] != j[q]) & (np.minimum(length_a, length_b) >= SHORTEST_M)
    p, q, along_a, along_b, ends_m2 = p[fits], q[fits], along_a[fits], along_b[fits], ends_m2[fits]
    cross = along_b[:, 0] * along_a[:, 1] - along_b[:, 1] * along_a[:, 0]
    yaw = np.arctan2(cross, (along_a * along_b).sum(axis=1))
    return Motions(
        yaw,
        (a[i[p]] + a[i[q]]) / 2.0,
        (b[j[p]] + b[j[q]]) / 2.0,
        ends_m2 / 4.0,
        ends_m2 / (along_a**2).sum(axis=1),
    )


def best_modes(motions: Motions, first: Places, second: Places, reach_m: float) -> Generator[None, None, list[SE2]]:
    """The motions that match the most objects, 16 at most, best first, clearly different from each other; yields
    after every unit of work."""
    scores = yield from _scores(motions, first, second, reach_m)
    centre = motions.apply(second.positions_m.mean(axis=0)[None])[:, 0]
    alive, modes = np.ones(len(scores), dtype=bool), []
    while alive.any() and len(modes) < 16:
        row = int(np.argmax(np.where(alive, scores, -1.0)))
        modes.append(motions.pose(row))
        rotation = np.abs(wrap_angles(motions.yaw_rad - motions.yaw_rad[row]))
        alive &= (((centre - centre[row]) ** 2).sum(axis=1) > SAME_PLACE_M**2) | (rotation > SAME_TURN_RAD)
    return modes


def _scores(motions: Motions, first: Places, second: Places, reach_m: float) -> Generator[None, None, Array]:
    """Number of objects that each motion explains, (N,): an object counts less with distance, 0 at the gate."""
    a, b = first.positions_m, second.positions_m
    pair_m2 = first.variances_m2[:, None] + second.variances_m2
    same = first.labels[:, None] == second.labels
    scores = np.zeros(len(motions.yaw_rad))
    size = max(CHUNK // max(same.size, 1), 1)
    for start in range(0, len(scores), size):
        chunk = Motions(*(values[start : start + size] for values in motions))
        placed = chunk.apply(b)
        apart2 = ((placed[:, None] - a[None, :, None]) ** 2).sum(axis=-1)
        lever2 = ((b[None] - chunk.middle_b_m[:, None]) ** 2).sum(axis=-1)
        vague_m2 = chunk.place_m2[:, None] + chunk.turn_rad2[:, None] * lever2
        variance_m2 = pair_m2[None] + vague_m2[:, None]
        near = 1.0 - apart2 / (CHI2_997 * variance_m2)
        near *= pair_m2[None] / variance_m2  # a vague motion explains much, and says little by it
        near[(apart2 > reach_m**2) | ~same[None]] = 0.0
        near = np.maximum(near, 0.0)
        scores[start : start + size] = np.minimum(near.max(axis=1).sum(axis=1), near.max(axis=2).sum(axis=1))
        for _ in range(max(1, same.size // CHUNK)):  # one motion of large maps is several units
            yield
    return scores


def _correspondences(first: Places, second: Places) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Rows of the first and of the second map with one label; of more than 200, of which every two are tried, some of
    the most frequent labels are drawn."""
    i, j = np.nonzero(first.labels[:, None] == second.labels)
    random, chosen = np.random.default_rng(0), list[int]()
    by_label = [np.flatnonzero(first.labels[i] == label) for label in dict.fromkeys(first.labels[i].tolist())]
    for rows in sorted(by_label, key=len):
        room = max(200 - len(chosen), 0)
        if len(rows) > room:
            rows = rows[np.sort(random.choice(len(rows), room, replace=False))]
        chosen += rows.tolist()
    return i[chosen], j[chosen]
