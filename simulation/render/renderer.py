"""Pictures, object ids and metric depth of a lit scene, with OpenGL on the processor (EGL, no screen)."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from itertools import product
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.intrinsics import Intrinsics
from edgemap.simulation.errors import SimulationError, require
from edgemap.simulation.render import shaders
from edgemap.simulation.render.mesh import Array, Material
from edgemap.simulation.render.scene import ROOM_ID, LitScene
from edgemap.simulation.render.view import NEAR_M, View, projection


@dataclass(slots=True)
class _Batch:
    """One draw call: triangles of one material."""

    id: int
    material: Material
    corners: Array
    colour: Any
    identity: Any
    light_map: Any = None
    map_scale: tuple[float, float] = (1.0, 1.0)


class Renderer:
    """Draws one lit scene through one camera. Raises SimulationError where OpenGL is missing, or for a lens with
    distortion, which this renderer does not bend."""

    def __init__(self, scene: LitScene, intrinsics: Intrinsics, exposure: float = 1.0, oversampling: int = 2) -> None:
        if not intrinsics.distortion.is_identity:
            raise SimulationError(f"the renderer draws no lens distortion ({intrinsics.distortion.model})")
        self.intrinsics = intrinsics
        # Several contexts may live side by side: every public method makes its own one current.
        self._gl = require("moderngl")
        self._context = _context(self._gl)
        size = (intrinsics.width, intrinsics.height)
        context = self._context
        # Mesa's multisampling takes seconds for some views, so pictures are drawn larger and averaged.
        large = (oversampling * intrinsics.width, oversampling * intrinsics.height)
        self._fine = context.framebuffer([context.renderbuffer(large, 4)], context.depth_renderbuffer(large))
        self._exact = context.framebuffer([context.renderbuffer(size, 2, dtype="f4")], context.depth_renderbuffer(size))
        self._colour = context.program(shaders.VERTEX, shaders.COLOUR)
        self._identity = context.program(shaders.VERTEX, shaders.IDENTITY)
        self._textures: dict[int, Any] = {}
        self._white = self._uploaded(np.full((16, 16, 4), 255, dtype=np.uint8))
        self._unlit = self._light_map(np.zeros((3, 3, 3), dtype=np.float32))
        self._batches = self._build(scene)
        self._corners = np.stack([batch.corners for batch in self._batches])
        self._see_through = np.array([batch.material.opacity < 0.99 for batch in self._batches])
        self._set_light(scene, exposure)

    def picture(self, view: View) -> NDArray[np.uint8]:
        """The picture, (H, W, 3) uint8 BGR, anti-aliased."""
        with self._context:
            raw = self._draw_picture(view)
        columns, rows = self._fine.size
        large = np.frombuffer(raw, dtype=np.uint8).reshape(rows, columns, 3)
        size = (self.intrinsics.width, self.intrinsics.height)
        small = np.asarray(cv2.resize(large, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)
        return np.ascontiguousarray(small[::-1, :, ::-1])

    def ids_and_depth(self, view: View) -> tuple[NDArray[np.int32], NDArray[np.float32]]:
        """Object ids (H, W), ROOM_ID for the room, and optical depth (H, W) in metres, both at pixel centres."""
        with self._context:
            exact = self._draw_identity(view, self.intrinsics, None)
        return exact[..., 0].astype(np.int32), exact[..., 1]

    def silhouette_px(self, view: View, id_: int) -> float:
        """Pixels that an object alone would cover in a picture twice as wide and high (for what the border cuts)."""
        wide = replace(
            self.intrinsics,
            fx=self.intrinsics.fx / 2.0,
            fy=self.intrinsics.fy / 2.0,
            cx=(self.intrinsics.cx + 0.5) / 2.0 + self.intrinsics.width / 4.0 - 0.5,
            cy=(self.intrinsics.cy + 0.5) / 2.0 + self.intrinsics.height / 4.0 - 0.5,
        )
        with self._context:
            alone = self._draw_identity(view, wide, id_)
        return 4.0 * float((alone[..., 0] == id_).sum())

    def close(self) -> None:
        """Give the OpenGL context back."""
        self._context.release()

    def _aim(self, program: Any, view: View, intrinsics: Intrinsics) -> list[_Batch]:
        """Set a program's camera; returns the batches that may be in view, near ones first, see-through ones last."""
        optical_home = np.eye(4)
        optical_home[:3, :3] = view.rotation_home_optical.T
        optical_home[:3, 3] = -view.rotation_home_optical.T @ view.position_home_m
        clip_home = projection(intrinsics) @ optical_home
        program["clip_home"].write(clip_home.T.astype("f4").tobytes())
        program["eye"] = tuple(view.position_home_m)
        corners = self._corners @ clip_home[:, :3].T + clip_home[:, 3]
        sides, w = corners[..., :2], corners[..., 3:]
        outside = np.all(sides < -w, axis=1).any(axis=-1) | np.all(sides > w, axis=1).any(axis=-1)
        outside |= np.all(w[..., 0] < NEAR_M, axis=1)
        order = np.lexsort((np.maximum(w[..., 0], 0.0).mean(axis=1), self._see_through))
        return [self._batches[i] for i in order if not outside[i]]

    def _draw_picture(self, view: View) -> bytes:
        in_view = self._aim(self._colour, view, self.intrinsics)
        self._fine.use()
        self._fine.clear(0.0, 0.0, 0.0, 1.0)
        self._context.enable_only(self._gl.DEPTH_TEST)
        for batch in in_view:
            if batch.material.opacity < 0.99:
                self._context.enable(self._gl.BLEND)
            self._draw_colour(batch)
        return self._fine.read(components=3, alignment=1)

    def _draw_colour(self, batch: _Batch) -> None:
        program, material = self._colour, batch.material
        self._texture(material).use(0)
        (self._unlit if batch.light_map is None else batch.light_map).use(1)
        program["has_image"] = material.texture is not None
        program["has_map"] = batch.light_map is not None
        program["map_scale"] = batch.map_scale
        program["tint"] = material.colour
        program["emission"] = material.emission
        program["opacity"] = material.opacity
        program["gloss"] = material.gloss
        batch.colour.render()

    def _draw_identity(self, view: View, intrinsics: Intrinsics, only: int | None) -> NDArray[np.float32]:
        in_view = self._aim(self._identity, view, intrinsics)
        self._identity["forward"] = tuple(view.rotation_home_optical[:, 2])
        self._exact.use()
        self._exact.clear(-1.0 if only is not None else float(ROOM_ID), 0.0, 0.0, 0.0)
        self._context.enable_only(self._gl.DEPTH_TEST)
        for batch in in_view:
            if only is not None and only != batch.id:
                continue
            self._identity["has_image"] = batch.material.cut_out
            if batch.material.cut_out:
                self._texture(batch.material).use(0)
            batch.identity.render()
        raw = self._exact.read(components=2, dtype="f4")
        return np.frombuffer(raw, dtype=np.float32).reshape(intrinsics.height, intrinsics.width, 2)[::-1]

    def _build(self, scene: LitScene) -> list[_Batch]:
        batches = []
        for surface, light_map in scene.surfaces:
            part = surface.part()
            dark = np.zeros_like(part.positions)
            batch = self._batch(ROOM_ID, part.material, part.positions, part.normals, part.uv, dark, dark)
            batch.light_map = self._light_map(light_map)
            batch.map_scale = (float(1.0 / part.uv[..., 0].max()), float(1.0 / part.uv[..., 1].max()))
            batches.append(batch)
        for lit in scene.parts:
            part = lit.part
            batches.append(
                self._batch(lit.id, part.material, part.positions, part.normals, part.uv, lit.front, lit.back)
            )
        return batches

    def _batch(self, id_: int, material: Material, *attributes: Array | NDArray[np.float32]) -> _Batch:
        columns = [np.asarray(a, dtype=np.float32).reshape(-1, a.shape[-1]) for a in attributes]
        rows = np.concatenate([*columns, np.full((len(columns[0]), 1), id_, dtype=np.float32)], axis=1)
        low, high = columns[0].min(axis=0), columns[0].max(axis=0)
        buffer = self._context.buffer(rows.tobytes())
        colour = [(buffer, "3f 3f 2f 3f 3f 4x", "position", "normal", "uv", "front", "back")]
        identity = [(buffer, "3f 12x 2f 24x 1f", "position", "uv", "id")]
        return _Batch(
            id_,
            material,
            np.array(list(product(*zip(low, high, strict=True)))),
            self._context.vertex_array(self._colour, colour),
            self._context.vertex_array(self._identity, identity),
        )

    def _texture(self, material: Material) -> Any:
        image = material.texture
        if image is None:
            return self._white
        if id(image) not in self._textures:
            self._textures[id(image)] = self._uploaded(image)
        return self._textures[id(image)]

    def _uploaded(self, image: NDArray[np.uint8]) -> Any:
        """A texture with mipmaps, its sides powers of two: Mesa compiles every shader anew for each KIND of texture."""
        size = tuple(1 << max(4, round(math.log2(side))) for side in image.shape[1::-1])
        if size != image.shape[1::-1]:
            image = cv2.resize(image, size, interpolation=cv2.INTER_AREA)  # type: ignore[assignment]
        texture = self._context.texture(size, 4, image[::-1].tobytes())
        texture.build_mipmaps()
        texture.filter = (self._gl.LINEAR_MIPMAP_LINEAR, self._gl.LINEAR)
        return texture

    def _light_map(self, light: NDArray[np.float32]) -> Any:
        rgba = np.concatenate([light, np.ones_like(light[..., :1])], axis=2)
        texture = self._context.texture((light.shape[1], light.shape[0]), 4, rgba.tobytes(), dtype="f4")
        texture.repeat_x = texture.repeat_y = False
        return texture

    def _set_light(self, scene: LitScene, exposure: float) -> None:
        self._colour["image"], self._colour["light_map"] = 0, 1
        self._identity["image"] = 0
        self._colour["exposure"] = exposure
        lamps = [light.centre for light in scene.lights[:4]]
        powers = [light.radiance * 0.5 for light in scene.lights[:4]]
        blank = [np.zeros(3)] * (4 - len(lamps))
        self._colour["lamp_at"] = [tuple(lamp) for lamp in (*lamps, *blank)]
        self._colour["lamp_power"] = [tuple(power) for power in (*powers, *blank)]


def _context(moderngl: Any) -> Any:
    try:
        return moderngl.create_context(standalone=True, backend="egl", libgl="libGL.so.1", libegl="libEGL.so.1")
    except Exception as error:
        raise SimulationError(
            f"no OpenGL without a screen ({error}): apt-get install libegl1 libegl-mesa0 libgl1 libgl1-mesa-dri"
        ) from None
