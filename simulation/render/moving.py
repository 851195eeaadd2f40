"""Movers in OpenGL's memory: every shape is sent once, and lit at each pose."""

from collections.abc import Iterable

import numpy as np

from edgemap.simulation.render.batches import pack_parts
from edgemap.simulation.render.canvas import Meshes, RenderTarget
from edgemap.simulation.render.draw import Draw
from edgemap.simulation.render.mesh import Array, Mesh
from edgemap.simulation.render.movers import Mover, mid_air_light, stand
from edgemap.simulation.render.scene import LitPart, Probes
from edgemap.simulation.render.view import View


class Moving:
    """The shapes of movers so far. probes: the light in mid-air."""

    def __init__(self, canvas: RenderTarget, probes: Probes | None) -> None:
        self._canvas, self._probes = canvas, probes
        self._known: dict[int, tuple[Mesh, Meshes]] = {}

    def meshes(self, mesh: Mesh) -> Meshes:
        """A mover's mesh, sent when first asked for."""
        if id(mesh) not in self._known:
            dark = [np.zeros(part.positions.shape, dtype=np.float32) for part in mesh.parts]
            packed = pack_parts([LitPart(1, part, d, d) for part, d in zip(mesh.parts, dark, strict=True)])
            # The mesh is kept too, so that its id stays its own.
            self._known[id(mesh)] = mesh, Meshes(self._canvas, packed)
        return self._known[id(mesh)][1]

    def placed(self, view: View, clip: Array, mover: Mover, slot: int) -> list[Draw]:
        """A mover's batches, lit at its position. clip: (4, 4) from the home to the picture."""
        home_mover = mover.matrix_home_mover()
        meshes = self.meshes(mover.mesh)
        rows = meshes.packed.vertices
        turn = home_mover[:3, :3]
        lamp, day = mid_air_light(
            self._probes,
            rows["position"].astype(np.float64) @ turn.T + home_mover[:3, 3],
            rows["normal"][:, :3] / 127.0 @ turn.T,
        )
        rows["lamp_front"] = rows["lamp_back"] = lamp
        rows["day_front"] = rows["day_back"] = day
        meshes.vertices.write(rows.tobytes())
        eye = np.asarray(np.linalg.inv(home_mover) @ [*view.position_home_m, 1.0], dtype=np.float64)
        return [Draw(meshes, batch, slot, clip @ home_mover, eye[:3], home_mover) for batch in meshes.packed.batches]

    def points_home_m(self, mover: Mover) -> Array:
        """A mover's corners (N, 3) in the home frame."""
        home_mover = mover.matrix_home_mover()
        points = self.meshes(mover.mesh).packed.vertices["position"].astype(np.float64)
        return points @ home_mover[:3, :3].T + home_mover[:3, 3]

    def shadows(self, clip: Array, movers: Iterable[Mover]) -> list[tuple[Array, tuple[float, float, float, float]]]:
        """Inputs of `RenderTarget.shadow`: a clip matrix per mover, and its floor contact."""
        return [
            (clip @ mover.matrix_home_mover(), stand(self.meshes(mover.mesh).packed.vertices["position"]))
            for mover in movers
        ]
