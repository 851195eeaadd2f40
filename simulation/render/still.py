"""A lit home in OpenGL's memory: its batches, its light maps, and its bare walls, which hide what is behind them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from edgemap.simulation.render.atlas import Atlas
from edgemap.simulation.render.batches import Batch, pack_parts, pack_surfaces
from edgemap.simulation.render.canvas import Meshes, RenderTarget, depth_of
from edgemap.simulation.render.culling import in_view
from edgemap.simulation.render.mesh import Array
from edgemap.simulation.render.scene import ROOM_ID, LightMix, LitScene
from edgemap.simulation.render.view import metres

_WALLS_PX = (80, 60)


class Still:
    """All of a lit scene that never moves. parts: the meshes of its solids, None where there are none."""

    def __init__(self, canvas: RenderTarget, scene: LitScene) -> None:
        self._canvas = canvas
        self._light: LightMix | None = None
        self._atlas = Atlas(scene.surfaces)
        self._light_map = canvas.context.texture(self._atlas.size, 4, dtype="f2")
        self._light_map.repeat_x = self._light_map.repeat_y = False
        self.parts = Meshes(canvas, pack_parts(scene.parts)) if scene.parts else None
        self._walls = Meshes(canvas, pack_surfaces(scene.surfaces, self._atlas.places)) if scene.surfaces else None
        some = [meshes for meshes in (self.parts, self._walls) if meshes is not None]
        self._all = [(meshes, batch) for meshes in some for batch in meshes.packed.batches]
        self._corners = np.array([batch.corners for _, batch in self._all]).reshape(-1, 8, 3)
        self._small = canvas.target(_WALLS_PX, 0)
        self._batches_of: dict[int, list[Batch]] = {}
        for batch in self.parts.packed.batches if self.parts else ():
            self._batches_of.setdefault(batch.id, []).append(batch)

    def batches_of(self, id_: int) -> list[Batch]:
        """The batches, in `parts`, that one object is made of."""
        return self._batches_of.get(id_, [])

    def points(self) -> dict[int, Array]:
        """Corners (N, 3) of every object, metres in the home."""
        points: dict[int, list[Array]] = {}
        if self.parts is not None:
            packed = self.parts.packed
            for batch in packed.batches:
                used = np.unique(packed.indices[batch.first : batch.first + batch.count])
                points.setdefault(batch.id, []).append(packed.vertices["position"][used].astype(np.float64))
        return {id_: np.concatenate(some) for id_, some in points.items() if id_ != ROOM_ID}

    def in_view(self, clip: Array) -> list[tuple[Meshes, Batch]]:
        """The batches that may be seen, near ones first."""
        seen, depth = in_view(self._corners, clip, self._walls_m(clip))
        return [self._all[index] for index in seen[np.argsort(depth[seen], kind="stable")]]

    def light(self, light: LightMix) -> None:
        """Have the light maps shine in a mix of light."""
        if light != self._light:
            self._light_map.write(self._atlas.mixed(light).tobytes())
            self._light = light
        self._light_map.use(1)

    def _walls_m(self, clip: Array) -> NDArray[np.float32] | None:
        """Optical depth of the bare walls in a small picture; None where there are no walls."""
        if self._walls is None:
            return None
        program = self._canvas.walls
        program["clip_home"].write(clip.T.astype("f4").tobytes())
        self._small.use()
        self._small.clear(depth=1.0)
        self._canvas.context.enable_only(self._canvas.gl.DEPTH_TEST)
        self._walls.array(program).render()
        return metres(depth_of(self._small))
