"""Pictures, object ids and metric depth of a lit scene, with OpenGL on the processor (EGL, no screen).

Drawn are solid objects, shadows of movers on the floor, then transparent objects; glossy surfaces have highlights.
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
from edgemap.simulation.render.canvas import DISPLAY, LAMPS, Draw, RenderTarget
from edgemap.simulation.render.mesh import Array
from edgemap.simulation.render.movers import Mover, Moving
from edgemap.simulation.render.scene import ROOM_ID, AreaLight, LightMix, LitScene
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


_NOWHERE = (0.0, 0.0, 0.0)
_Place = tuple[float, ...]


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
        self._lights = scene.lights
        self._near_batch: dict[int, list[tuple[AreaLight, _Place]]] = {}
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
                    for part in (*self._fine.color_attachments, self._fine.depth_attachment, self._fine):
                        part.release()
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
            opaque, glass = ([d for d in draws if d.batch.material.see_through == blended] for blended in (False, True))
            self._still.light(light)
            self._fine.use()
            self._fine.clear(0.0, 0.0, 0.0, 0.0)
            self._canvas.context.enable_only(self._canvas.gl.DEPTH_TEST)
            for draw in opaque:
                self._colour(draw, light, exposure, draw.slot / 255.0)
            self._shadows(clip, movers)
            self._see_through(glass, light, exposure)
            return self._read(list(slots))

    def whole(self, view: View, ids: Sequence[int], movers: Iterable[Mover] = ()) -> tuple[list[Array], Array]:
        """Per object its unoccluded box, cut by the picture: (x0, y0, x1, y1) px, pixel k covering k to k + 1; and the
        area in px, in and around the picture, that it would cover (before the lens bends it).
        """
        with self._canvas.context:
            return self._wholes.of(view, self._lens, list(ids), {mover.id: mover for mover in movers})

    def visible_px(self, ids: NDArray[np.int32]) -> Array:
        """Area in px that each id covers in an id picture, index by id; comparable with `whole`'s areas."""
        area = self._lens.area_px
        return np.bincount(ids.ravel(), weights=None if area is None else area.ravel()).astype(np.float64)

    def close(self) -> None:
        """Releases the OpenGL context."""
        self._canvas.context.release()

    def _shadows(self, clip: Array, movers: Iterable[Mover]) -> None:
        self._write(colour=True, slot=False, depth=False, blend=True)
        for mover in movers:
            self._canvas.shadow(clip @ mover.matrix_home_mover, self._moving.stand(mover))
        self._write(colour=True, slot=True)

    def _see_through(self, draws: list[Draw], light: LightMix, exposure: float) -> None:
        """Blended colours, far ones first; then their ids, which cannot be blended."""
        self._write(colour=True, slot=False, blend=True)
        for draw in reversed(draws):
            self._colour(draw, light, exposure, draw.batch.material.opacity)
        self._write(colour=False, slot=True)
        self._canvas.context.depth_func = "<="
        for draw in draws:
            self._colour(draw, light, exposure, draw.slot / 255.0)
        self._canvas.context.depth_func = "<"
        self._write(colour=True, slot=True)

    def _write(self, colour: bool, slot: bool, depth: bool = True, blend: bool = False) -> None:
        """Choose what drawing changes. Masks count from the next `use` on."""
        self._fine.color_mask, self._fine.depth_mask = (colour, colour, colour, slot), depth
        self._fine.use()
        context = self._canvas.context
        (context.enable if blend else context.disable)(self._canvas.gl.BLEND)

    def _colour(self, draw: Draw, light: LightMix, exposure: float, slot: float) -> None:
        batch, material = draw.batch, draw.batch.material
        program = self._canvas.program(batch.needs)
        glow = np.array(material.emission) * getattr(light, material.group)
        values = {"eye": tuple(draw.eye), "glow": tuple(glow), "exposure": exposure, "slot": slot}
        values |= {"day": light.day, "lamp": light.lamp, "gloss": material.gloss}
        for name, value in values.items():
            uniform = program.get(name, None)
            if uniform is not None:
                uniform.value = value
        program["clip_home"].write(draw.clip.T.astype("f4").tobytes())
        if "GLOSSY" in batch.needs:
            self._highlights(program, draw, light)
        if material.texture is not None:
            self._canvas.texture(material.texture).use(0)
        draw.meshes.array(program).render(vertices=batch.count, first=batch.first)

    def _highlights(self, program: Any, draw: Draw, light: LightMix) -> None:
        """The lights nearest to a glossy batch, as it sees them; those that are switched off cost nothing."""
        on = [(lamp, at) for lamp, at in self._near(draw) if getattr(light, lamp.group) > 0.0]
        none = [_NOWHERE] * (LAMPS - len(on))
        program["lamps"] = len(on)
        program["lamp_at"] = [at for _, at in on] + none
        program["lamp_power"] = [tuple(lamp.radiance * (0.5 * getattr(light, lamp.group))) for lamp, _ in on] + none

    def _near(self, draw: Draw) -> list[tuple[AreaLight, _Place]]:
        """The nearest lights, and where they are in the frame of the batch; worked out once for what never moves."""
        key = id(draw.batch)
        if draw.home is not None or key not in self._near_batch:
            home = np.eye(4) if draw.home is None else draw.home
            middle, local = (home @ [*draw.batch.corners.mean(axis=0), 1.0])[:3], np.linalg.inv(home)
            near = sorted(self._lights, key=lambda lamp: float(np.linalg.norm(lamp.centre - middle)))[:LAMPS]
            self._near_batch[key] = [(lamp, tuple((local @ [*lamp.centre, 1.0])[:3])) for lamp in near]
        return self._near_batch[key]

    def _read(self, ids: list[int]) -> RenderedFrame:
        """The picture that was drawn. ids: of its slots."""
        size = (self._pinhole.height, self._pinhole.width)
        raw = np.frombuffer(self._fine.read(components=4, alignment=1), dtype=np.uint8).reshape(*size, 4)
        depth = self._fine.read(components=1, attachment=-1, dtype="f4", alignment=1)
        small = cv2.pyrDown(raw, dstsize=(self._lens.pinhole.width, size[0] // 2))
        colour = cv2.LUT(np.ascontiguousarray(small[..., :3]), DISPLAY)
        exact_ids = np.array(ids, dtype=np.int32)[self._lens.exact(raw[..., 3])]
        exact_depth = self._lens.exact(np.frombuffer(depth, dtype=np.float32).reshape(size))
        return RenderedFrame(self._lens.colour(np.asarray(colour, dtype=np.uint8)), exact_ids, metres(exact_depth))
