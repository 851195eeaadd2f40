"""Moving objects in a lit home: rigid meshes, sent to OpenGL once, placed and lit for every picture."""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import map_coordinates

from edgemap.geometry.se2 import SE2
from edgemap.simulation.render.batches import pack_parts
from edgemap.simulation.render.canvas import Draw, Meshes, RenderTarget
from edgemap.simulation.render.mesh import Array, Mesh
from edgemap.simulation.render.scene import LitPart, Probes
from edgemap.simulation.render.view import View

# How high feet are, and how far their shadow reaches beyond them.
_FOOT_M, _SHADOW_M = 0.12, 0.22


@dataclass(frozen=True, slots=True, eq=False)
class Mover:
    """A mesh at a pose for one picture. id: its value in the id picture, distinct from the furniture's.

    mesh: in the mover's frame (x ahead, y left, z up from the floor, metres); keep one object per shape, since a new
    mesh is sent to the graphics system again.
    """

    id: int
    mesh: Mesh
    pose_home_mover: SE2

    @property
    def matrix_home_mover(self) -> Array:
        """(4, 4) from the mover's frame to the home."""
        matrix = np.eye(4)
        matrix[:2, :2] = self.pose_home_mover.rotation()
        matrix[:2, 3] = self.pose_home_mover.x_m, self.pose_home_mover.y_m
        return matrix


def mid_air_light(probes: Probes, points: Array, normals: Array) -> Array:
    """Light (N, 6) at points with normals (N, 3) of one mover, in the home frame. Up the mover's height, from the
    probes round its middle; faces weighted by the squared normal (an ambient cube, Source engine 2004)."""
    middle = points.mean(axis=0)
    heights = probes.corner_m[2] + probes.step_m[2] * np.arange(probes.light.shape[2])
    at = (np.broadcast_to(middle, (len(heights), 3)) - probes.corner_m) / probes.step_m
    at[:, 2] = np.arange(len(heights))
    faces = np.moveaxis(probes.light.reshape(*probes.light.shape[:3], -1), -1, 0)
    column = np.stack([map_coordinates(face, at.T, order=1, mode="nearest") for face in faces], axis=1)
    level = np.clip((points[:, 2] - heights[0]) / probes.step_m[2], 0.0, len(heights) - 1.001)
    low, share = level.astype(int), (level % 1.0)[:, None]
    cube = ((1.0 - share) * column[low] + share * column[np.minimum(low + 1, len(heights) - 1)]).reshape(-1, 6, 6)
    weights = np.stack([np.maximum(sign * normals[:, axis], 0.0) ** 2 for axis in range(3) for sign in (1, -1)], axis=1)
    return (weights[..., None] * cube).sum(axis=1)


class Moving:
    """The shapes of movers so far. probes: the light in mid-air."""

    def __init__(self, canvas: RenderTarget, probes: Probes) -> None:
        self._canvas, self._probes = canvas, probes
        self._known: dict[int, tuple[Mesh, Meshes]] = {}

    def meshes(self, mesh: Mesh) -> Meshes:
        """A mover's mesh, sent when first asked for."""
        if id(mesh) not in self._known:
            dark = [np.zeros((len(part.positions), 3, 6), dtype=np.float32) for part in mesh]
            packed = pack_parts([LitPart(1, part, d, d) for part, d in zip(mesh, dark, strict=True)])
            # The mesh is kept too, so that its id stays its own.
            self._known[id(mesh)] = mesh, Meshes(self._canvas, packed)
        return self._known[id(mesh)][1]

    def placed(self, view: View, clip: Array, mover: Mover, slot: int) -> list[Draw]:
        """A mover's batches, lit at its position. clip: (4, 4) from the home to the picture."""
        home_mover, meshes = mover.matrix_home_mover, self.meshes(mover.mesh)
        rows = meshes.packed.vertices
        normals = rows["normal"][:, :3] / 127.0 @ home_mover[:3, :3].T
        lamp, day = np.split(mid_air_light(self._probes, self.points_home_m(mover), normals), 2, axis=1)
        rows["lamp_front"] = rows["lamp_back"] = lamp
        rows["day_front"] = rows["day_back"] = day
        meshes.vertices.write(rows.tobytes())
        eye = np.asarray(np.linalg.inv(home_mover) @ [*view.position_home_m, 1.0], dtype=np.float64)
        return [Draw(meshes, batch, slot, clip @ home_mover, eye[:3], home_mover) for batch in meshes.packed.batches]

    def points_home_m(self, mover: Mover) -> Array:
        """A mover's corners (N, 3) in the home frame."""
        home_mover = mover.matrix_home_mover
        points = self.meshes(mover.mesh).packed.vertices["position"].astype(np.float64)
        return points @ home_mover[:3, :3].T + home_mover[:3, 3]

    def stand(self, mover: Mover) -> tuple[float, float, float, float]:
        """Its floor contact, with a margin: middle and half sides (x, y, a, b), metres in the mover's frame."""
        points = self.meshes(mover.mesh).packed.vertices["position"]
        low = points[points[:, 2] < points[:, 2].min() + _FOOT_M, :2]
        middle, half = (low.min(axis=0) + low.max(axis=0)) / 2.0, (low.max(axis=0) - low.min(axis=0)) / 2.0 + _SHADOW_M
        return float(middle[0]), float(middle[1]), float(half[0]), float(half[1])
