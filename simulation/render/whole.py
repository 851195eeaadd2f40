"""Unoccluded objects: boxes in the picture, and areas from each one's silhouette drawn alone."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from edgemap.simulation.render import silhouettes
from edgemap.simulation.render.canvas import RenderTarget
from edgemap.simulation.render.lens import Lens
from edgemap.simulation.render.mesh import Array
from edgemap.simulation.render.movers import Mover
from edgemap.simulation.render.moving import Moving
from edgemap.simulation.render.silhouettes import COLUMNS, ROWS, TILE_PX
from edgemap.simulation.render.still import Still
from edgemap.simulation.render.view import View, clip_matrix


class Wholes:
    """Draws silhouettes side by side on one sheet."""

    def __init__(self, canvas: RenderTarget, still: Still, moving: Moving) -> None:
        self._canvas, self._still, self._moving = canvas, still, moving
        self._sheet = canvas.target((TILE_PX * COLUMNS, TILE_PX * ROWS), 1, depth=False)
        self._outlines = silhouettes.Outlines(still.points())

    def of(
        self, view: View, lens: Lens, ids: list[int], movers: dict[int, Mover]
    ) -> tuple[list[NDArray[np.float64]], NDArray[np.float64]]:
        """Boxes and areas, as `Renderer.whole` returns them. movers: by id."""
        pinhole = lens.pinhole
        clip = clip_matrix(view, pinhole)
        boxes, areas = [], np.zeros(len(ids))
        for start in range(0, len(ids), COLUMNS * ROWS):
            some = ids[start : start + COLUMNS * ROWS]
            self._sheet.use()
            self._sheet.clear()
            self._canvas.context.enable_only(self._canvas.gl.NOTHING)
            windows = []
            for number, id_ in enumerate(some):
                ideal = self._outline(id_, view, movers)
                boxes.append(_cut(ideal, lens))
                windows.append(silhouettes.window(silhouettes.pixel_box(ideal, pinhole), pinhole))
                row, column = divmod(number, COLUMNS)
                self._sheet.viewport = (column * TILE_PX, row * TILE_PX, TILE_PX, TILE_PX)
                self._alone(silhouettes.zoomed(clip, windows[-1], pinhole), id_, movers)
            covered = silhouettes.filled(self._sheet.read(components=1, alignment=1), len(some))
            sides = np.array(windows).reshape(-1, 2, 2)
            areas[start : start + len(some)] = covered * np.prod(sides[:, 1] - sides[:, 0], axis=1)
        return boxes, areas

    def _outline(self, id_: int, view: View, movers: dict[int, Mover]) -> Array:
        """An object's outermost points at unit depth of the optical frame; the axis itself where it is behind."""
        if id_ in movers:
            self._outlines.copy_of(id_, self._moving.points_home_m(movers[id_]))
        ideal = silhouettes.ideal_points(view.to_optical(self._outlines.of(id_)))
        return ideal if len(ideal) else np.zeros((1, 2))

    def _alone(self, clip: Array, id_: int, movers: dict[int, Mover]) -> None:
        if id_ in movers:
            meshes = self._moving.meshes(movers[id_].mesh)
            clip, batches = clip @ movers[id_].matrix_home_mover(), meshes.packed.batches
        else:
            meshes, batches = self._still.parts, self._still.batches_of(id_)
        if meshes is None:
            return
        program: Any = self._canvas.silhouette
        program["clip_home"].write(clip.T.astype("f4").tobytes())
        for batch in batches:
            program["holes"] = batch.kind.holes
            if batch.kind.holes:
                self._canvas.texture(batch.material.texture).use(0)
            meshes.array(program).render(vertices=batch.count, first=batch.first)


def _cut(ideal: Array, lens: Lens) -> NDArray[np.float64]:
    """The box of points at unit depth in the picture; points beside it are moved to where the lens is still known,
    which is outside of it."""
    intrinsics, pinhole = lens.intrinsics, lens.pinhole
    focal, centre = np.array([pinhole.fx, pinhole.fy]), np.array([pinhole.cx, pinhole.cy])
    low, high = (np.zeros(2) - centre) / focal, (np.array([pinhole.width, pinhole.height]) - centre) / focal
    box = silhouettes.pixel_box(np.clip(ideal, low, high), intrinsics)
    return np.clip(box, 0.0, np.tile([intrinsics.width, intrinsics.height], 2).astype(np.float64))
