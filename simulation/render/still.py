"""A lit home in OpenGL's memory: its batches and its light maps."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from edgemap.simulation.render.batches import Batch, pack_parts, pack_surfaces
from edgemap.simulation.render.canvas import Meshes, RenderTarget
from edgemap.simulation.render.mesh import Array
from edgemap.simulation.render.scene import LightMix, LitScene, LitSurface
from edgemap.simulation.render.view import NEAR_M

_WIDTH = 1024  # of the atlas


class Still:
    """All of a lit scene that never moves. parts: the meshes of its solids."""

    def __init__(self, canvas: RenderTarget, scene: LitScene) -> None:
        self._light: LightMix | None = None
        self._atlas = Atlas(scene.surfaces)
        self._light_map = canvas.context.texture(self._atlas.size, 4, dtype="f2")
        self._light_map.repeat_x = self._light_map.repeat_y = False
        self.parts = Meshes(canvas, pack_parts(scene.parts))
        self._all = [(self.parts, batch) for batch in self.parts.packed.batches]
        if scene.surfaces:
            walls = Meshes(canvas, pack_surfaces(scene.surfaces, self._atlas.places))
            self._all += [(walls, batch) for batch in walls.packed.batches]
        self._corners = np.array([batch.corners for _, batch in self._all]).reshape(-1, 8, 3)

    def batches_of(self, id_: int) -> list[Batch]:
        """The batches, in `parts`, that one object is made of."""
        return [batch for batch in self.parts.packed.batches if batch.id == id_]

    def points_home_m(self, id_: int) -> Array:
        """Corners (N, 3) of one object, metres in the home."""
        packed = self.parts.packed
        used = [np.unique(packed.indices[b.first : b.first + b.count]) for b in self.batches_of(id_)]
        return packed.vertices["position"][np.concatenate(used)].astype(np.float64)

    def in_view(self, clip: Array) -> list[tuple[Meshes, Batch]]:
        """The batches whose boxes reach into the view, near ones first."""
        corners = self._corners @ clip[:, :3].T + clip[:, 3]
        sides, depth = corners[..., :2], corners[..., 3]
        outside = np.all(sides < -depth[..., None], axis=1).any(axis=-1)
        outside |= np.all(sides > depth[..., None], axis=1).any(axis=-1)
        outside |= np.all(depth < NEAR_M, axis=1)
        seen, away = np.flatnonzero(~outside), np.maximum(depth, 0.0).mean(axis=1)
        return [self._all[index] for index in seen[np.argsort(away[seen], kind="stable")]]

    def light(self, light: LightMix) -> None:
        """Have the light maps shine in a mix of light."""
        if light != self._light:
            self._light_map.write(self._atlas.mixed(light).tobytes())
            self._light = light
        self._light_map.use(1)


class Atlas:
    """Light maps side by side. places: per surface (u0, v0, u1, v1), the map's own border in the texture, 0..1."""

    def __init__(self, surfaces: Sequence[LitSurface]) -> None:
        at = _shelves([lit.light.shape[:2] for lit in surfaces])
        rows = max([16, *(row + lit.light.shape[0] + 2 for (row, _), lit in zip(at, surfaces, strict=True))])
        self.size = (_WIDTH, 1 << (rows - 1).bit_length())
        self._sheet = np.zeros((self.size[1], _WIDTH, 6), dtype=np.float32)
        self.places: list[Array] = []
        for (row, column), lit in zip(at, surfaces, strict=True):
            height, width = lit.light.shape[:2]
            # One more texel all around, for the filter.
            bordered = np.pad(lit.light, ((1, 1), (1, 1), (0, 0)), "edge")
            self._sheet[row : row + height + 2, column : column + width + 2] = bordered
            low = np.array([column + 1, row + 1], dtype=np.float64)
            self.places.append(np.concatenate([low, low + [width, height]]) / [*self.size, *self.size])

    def mixed(self, light: LightMix) -> NDArray[np.float16]:
        """The texture, (rows, columns, 4)."""
        sheet = np.ones((self.size[1], _WIDTH, 4), dtype=np.float16)
        sheet[..., :3] = light.day * self._sheet[..., 3:] + light.lamp * self._sheet[..., :3]
        return sheet


def _shelves(shapes: Sequence[tuple[int, int]]) -> list[tuple[int, int]]:
    """Row and column of each map (with its border), tallest first, shelf on shelf. Maps wider than the atlas cannot be
    placed; `light.py` keeps them smaller."""
    at: list[tuple[int, int]] = [(0, 0)] * len(shapes)
    row = column = shelf = 0
    for number in sorted(range(len(shapes)), key=lambda n: -shapes[n][0]):
        height, width = shapes[number][0] + 2, shapes[number][1] + 2
        if column + width > _WIDTH:
            row, column, shelf = row + shelf, 0, 0
        at[number] = row, column
        column, shelf = column + width, max(shelf, height)
    return at
