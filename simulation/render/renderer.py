"""Pictures, object ids and metric depth of a lit scene, with OpenGL on the processor (EGL, no screen).

A picture with all of its truth costs the same processor time whatever LP_NUM_THREADS says (some 70 ms at 640x480 in
three rooms), but Mesa takes triangles in on one thread only. So let two processes draw, each with LP_NUM_THREADS=0 set
before the first Renderer; the pictures are the same.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.camera.intrinsics import Intrinsics
from edgemap.simulation.render.canvas import DISPLAY, Draw, RenderTarget, depth_of, release
from edgemap.simulation.render.movers import Mover, Moving
from edgemap.simulation.render.painter import Painter
from edgemap.simulation.render.scene import ROOM_ID, LightMix, LitScene
from edgemap.simulation.render.still import Still
from edgemap.simulation.render.view import Lens, View, clip_matrix, metres, oversampled
from edgemap.simulation.render.whole import Wholes


@dataclass(frozen=True, slots=True, eq=False)
class RenderedFrame:
    """One picture (H, W, 3) uint8 BGR with the object id (H, W) int32 and optical depth (H, W) in metres at every
    pixel's centre."""

    picture: NDArray[np.uint8]
    ids: NDArray[np.int32]
    depth_m: NDArray[np.float32]


class Renderer:
    """Draws one lit scene through one camera, bent lens or not. Raises SimulationError where OpenGL is missing."""

    def __init__(self, scene: LitScene, intrinsics: Intrinsics) -> None:
        self._canvas = RenderTarget()
        self._fine: Any = None
        # Several contexts may live side by side: every public method makes its own one current.
        with self._canvas.context:
            self._still = Still(self._canvas, scene)
            self._moving = Moving(self._canvas, scene.probes)
            self._wholes = Wholes(self._canvas, self._still, self._moving)
            self._painter = Painter(self._canvas, scene.lights)
        self.use_lens(intrinsics)

    def use_lens(self, intrinsics: Intrinsics) -> None:
        """Change the camera; the scene stays as it is."""
        lens = Lens(intrinsics)
        self.intrinsics, self._lens = intrinsics, lens
        self._pinhole = oversampled(lens.pinhole)
        size = (self._pinhole.width, self._pinhole.height)
        if self._fine is None or self._fine.size != size:
            with self._canvas.context:
                if self._fine is not None:
                    release(self._fine)
                self._fine = self._canvas.target(size)

    def frame(
        self,
        view: View,
        light: LightMix = LightMix(),  # noqa: B008 (frozen)
        exposure: float = 1.0,
        movers: Iterable[Mover] = (),
    ) -> RenderedFrame:
        """Anti-aliased picture, ids and depth in one go. exposure: factor on light before the display curve."""
        movers = tuple(movers)
        with self._canvas.context:
            clip = clip_matrix(view, self._pinhole)
            eye, slots = view.position_home_m, {ROOM_ID: 0}
            draws: list[Draw] = []  # movers, then near batches first
            for mover in movers:
                draws += self._moving.placed(view, clip, mover, slots.setdefault(mover.id, len(slots)))
            for meshes, batch in self._still.in_view(clip):
                draws.append(Draw(meshes, batch, slots.setdefault(batch.id, len(slots)), clip, eye))
            self._still.light(light)
            self._painter.paint(self._fine, draws, self._moving.shadows(clip, movers), light, exposure)
            return self._read(list(slots))

    def whole(
        self, view: View, ids: Sequence[int], movers: Iterable[Mover] = ()
    ) -> tuple[list[NDArray[np.float64]], NDArray[np.float64]]:
        """Per object its unoccluded box, cut by the picture: (x0, y0, x1, y1) px, pixel k covering k to k + 1; and the
        area in px, in and around the picture, that it would cover (before the lens bends it).
        """
        with self._canvas.context:
            return self._wholes.of(view, self._lens, list(ids), {mover.id: mover for mover in movers})

    def visible_px(self, ids: NDArray[np.int32]) -> NDArray[np.float64]:
        """Area in px that each id covers in an id picture, index by id; comparable with `whole`'s areas."""
        area = self._lens.area_px
        return np.bincount(ids.ravel(), weights=None if area is None else area.ravel()).astype(np.float64)

    def close(self) -> None:
        """Releases the OpenGL context."""
        self._canvas.close()

    def _read(self, ids: list[int]) -> RenderedFrame:
        """The picture that was drawn. ids: of its slots."""
        size = (self._pinhole.height, self._pinhole.width)
        raw = np.frombuffer(self._fine.read(components=4, alignment=1), dtype=np.uint8).reshape(*size, 4)
        depth = depth_of(self._fine)
        small = cv2.pyrDown(raw, dstsize=(self._lens.pinhole.width, size[0] // 2))
        colour = cv2.LUT(np.ascontiguousarray(small[..., :3]), DISPLAY)
        exact_ids = np.array(ids, dtype=np.int32)[self._lens.exact(raw[..., 3])]
        exact_depth = self._lens.exact(depth)
        return RenderedFrame(self._lens.colour(np.asarray(colour, dtype=np.uint8)), exact_ids, metres(exact_depth))
