"""Objects without occlusion: their boxes in the picture, and their areas from silhouettes drawn one by one."""

from collections.abc import Iterable
from contextlib import suppress
from typing import Any

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from edgemap.geometry.camera.intrinsics import Intrinsics
from edgemap.simulation.render.batches import Batch
from edgemap.simulation.render.canvas import Meshes, RenderTarget
from edgemap.simulation.render.mesh import Array
from edgemap.simulation.render.movers import Mover, Moving
from edgemap.simulation.render.still import Still
from edgemap.simulation.render.view import NEAR_M, Lens, View, clip_matrix

TILE_PX, COLUMNS, ROWS = 64, 16, 8  # of the sheet: room for twice what is in a home
# Objects that reach out of the picture are followed this far, as a factor on the picture's size.
_REACH = 2.0
_MANY = 500


def outline(points: Array) -> Array:
    """The points (N, 3) that can lie on the outline of an object: corners of their convex hull."""
    if len(points) <= _MANY:
        return points
    # A flat object has no hull: all its points are used.
    with suppress(QhullError):
        return points[ConvexHull(points).vertices]
    return points


def ideal_points(points_optical_m: Array) -> Array:
    """Projects convex points (N, 3) of the optical frame to unit depth, (M, 2). Points behind the near plane are
    replaced by intersections with it; where all are behind, the axis stands for them."""
    ahead = points_optical_m[:, 2] >= NEAR_M
    front, behind = points_optical_m[ahead], points_optical_m[~ahead]
    if len(front) and len(behind):
        share = ((NEAR_M - behind[:, 2])[:, None] / (front[:, 2] - behind[:, None, 2])).astype(np.float64)
        cut = behind[:, None] + share[..., None] * (front - behind[:, None])
        front = np.concatenate([front, cut.reshape(-1, 3)])
    return front[:, :2] / front[:, 2:] if len(front) else np.zeros((1, 2))


def pixel_box(ideal: Array, intrinsics: Intrinsics) -> Array:
    """(x0, y0, x1, y1) px round points at unit depth, pixel k covering k to k + 1, with the lens's distortion."""
    at = intrinsics.distortion.distort(ideal) * [intrinsics.fx, intrinsics.fy] + [intrinsics.cx, intrinsics.cy] + 0.5
    return np.concatenate([at.min(axis=0), at.max(axis=0)])


def window(box: Array, pinhole: Intrinsics) -> Array:
    """The part of an object's box in which its area is counted: at most twice the picture's size, about its centre."""
    size = np.array([pinhole.width, pinhole.height], dtype=np.float64)
    low, high = size / 2.0 - _REACH * size / 2.0, size / 2.0 + _REACH * size / 2.0
    first, last = np.clip(box[:2], low, high), np.clip(box[2:], low, high)
    return np.concatenate([first, np.maximum(last, first + 1e-3)])


def zoomed(clip_home: Array, box: Array, pinhole: Intrinsics) -> Array:
    """A clip matrix that fills the viewport with a window (x0, y0, x1, y1) px of the picture."""
    size = np.array([pinhole.width, pinhole.height])
    low, high = box[:2] / size * 2.0 - 1.0, box[2:] / size * 2.0 - 1.0
    zoom = np.diag([*(2.0 / (high - low)), 1.0, 1.0])
    zoom[:2, 3] = -(high + low) / (high - low)
    return zoom @ clip_home


class Wholes:
    """Draws silhouettes as tiles of one sheet."""

    def __init__(self, canvas: RenderTarget, still: Still, moving: Moving) -> None:
        self._canvas, self._still, self._moving = canvas, still, moving
        self._sheet = canvas.target((TILE_PX * COLUMNS, TILE_PX * ROWS), 1, depth=False)
        self._outlines: dict[int, Array] = {}

    def of(self, view: View, lens: Lens, ids: list[int], movers: dict[int, Mover]) -> tuple[list[Array], Array]:
        """Boxes and areas, as `Renderer.whole` returns them. movers: by id."""
        pinhole = lens.pinhole
        clip = clip_matrix(view, pinhole)
        self._sheet.use()
        self._sheet.clear()
        self._canvas.context.enable_only(self._canvas.gl.NOTHING)
        boxes, windows = [], []
        for number, id_ in enumerate(ids):
            if id_ in movers:
                points, home = outline(self._moving.points_home_m(movers[id_])), movers[id_].matrix_home_mover
                meshes = self._moving.meshes(movers[id_].mesh)
                batches = meshes.packed.batches
            else:
                points, home = self._outline(id_), np.eye(4)
                meshes, batches = self._still.parts, self._still.batches_of(id_)
            ideal = ideal_points(view.to_optical(points))
            boxes.append(_cut(ideal, lens))
            windows.append(window(pixel_box(ideal, pinhole), pinhole))
            row, column = divmod(number, COLUMNS)
            self._sheet.viewport = (column * TILE_PX, row * TILE_PX, TILE_PX, TILE_PX)
            self._alone(zoomed(clip, windows[-1], pinhole) @ home, meshes, batches)
        sheet = np.frombuffer(self._sheet.read(components=1, alignment=1), dtype=np.uint8)
        covered = (sheet.reshape(ROWS, TILE_PX, COLUMNS, TILE_PX) > 127).mean(axis=(1, 3)).ravel()[: len(ids)]
        sides = np.array(windows).reshape(-1, 2, 2)
        return boxes, covered * np.prod(sides[:, 1] - sides[:, 0], axis=1)

    def _outline(self, id_: int) -> Array:
        """Outermost points (N, 3) of an object that never moves, metres in the home."""
        if id_ not in self._outlines:
            self._outlines[id_] = outline(self._still.points_home_m(id_))
        return self._outlines[id_]

    def _alone(self, clip: Array, meshes: Meshes, batches: Iterable[Batch]) -> None:
        program: Any = self._canvas.silhouette
        program["clip_home"].write(clip.T.astype("f4").tobytes())
        for batch in batches:
            image = batch.material.texture if "HOLES" in batch.needs else None
            program["holes"] = image is not None
            if image is not None:
                self._canvas.texture(image).use(0)
            meshes.array(program).render(vertices=batch.count, first=batch.first)


def _cut(ideal: Array, lens: Lens) -> Array:
    """The box of points at unit depth in the picture; points far outside are moved to where the distortion is still
    defined, which is outside the picture as well."""
    intrinsics, pinhole = lens.intrinsics, lens.pinhole
    focal, centre = np.array([pinhole.fx, pinhole.fy]), np.array([pinhole.cx, pinhole.cy])
    low, high = (np.zeros(2) - centre) / focal, (np.array([pinhole.width, pinhole.height]) - centre) / focal
    box = pixel_box(np.clip(ideal, low, high), intrinsics)
    return np.clip(box, 0.0, np.tile([intrinsics.width, intrinsics.height], 2).astype(np.float64))
