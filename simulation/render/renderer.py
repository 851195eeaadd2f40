"""Pictures, object ids and metric depth of a lit scene, with OpenGL on the processor (EGL, no screen).

A picture with all of its truth costs the same processor time whatever LP_NUM_THREADS says (some 70 ms at 640x480 in
three rooms), but Mesa takes triangles in on one thread only. So let two processes draw, each with LP_NUM_THREADS=0 set
before the first Renderer; the pictures are the same.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.intrinsics import Intrinsics
from edgemap.simulation.render import shaders, silhouettes
from edgemap.simulation.render.atlas import Atlas
from edgemap.simulation.render.batches import Batch, pack_parts, pack_surfaces
from edgemap.simulation.render.canvas import Canvas, Meshes, release
from edgemap.simulation.render.culling import in_view
from edgemap.simulation.render.lens import Lens
from edgemap.simulation.render.mesh import Array, Mesh
from edgemap.simulation.render.movers import Mover, mid_air_light, stand
from edgemap.simulation.render.scene import ROOM_ID, AreaLight, LightMix, LitPart, LitScene
from edgemap.simulation.render.view import FAR_M, NEAR_M, View, clip_matrix, oversampled

_WALLS_PX = (80, 60)
# One byte per pixel tells the objects of one picture apart.
_MOST_OBJECTS = 254
_NOWHERE = (0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True, eq=False)
class Frame:
    """One picture (H, W, 3) uint8 BGR with the object id (H, W) int32 and optical depth (H, W) in metres at every
    pixel's centre."""

    picture: NDArray[np.uint8]
    ids: NDArray[np.int32]
    depth_m: NDArray[np.float32]


@dataclass(frozen=True, slots=True)
class _Draw:
    """One batch to draw: from which meshes, with which slot in the id byte, and where it stands."""

    meshes: Meshes
    batch: Batch
    slot: int
    clip: Array
    eye: Array
    home: Array | None = None


class Renderer:
    """Draws one lit scene through one camera, bent lens or not. Raises SimulationError where OpenGL is missing or a
    lens cannot be drawn.

    exposure: factor on light before the display curve. oversampling: 1 (jagged, for what only needs ids) or 2.
    """

    def __init__(self, scene: LitScene, intrinsics: Intrinsics, exposure: float = 1.0, oversampling: int = 2) -> None:
        self.exposure, self._times = exposure, oversampling
        self._canvas = Canvas()
        self._fine: Any = None
        self._light: LightMix | None = None
        self._last: tuple[Any, Frame] | None = None
        # Several contexts may live side by side: every public method makes its own one current.
        with self._canvas.context:
            self._load(scene)
        self.look_through(intrinsics)

    def look_through(self, intrinsics: Intrinsics) -> None:
        """Change the camera; the scene stays as it is. Raises SimulationError for a lens that cannot be drawn."""
        lens = Lens(intrinsics)
        self.intrinsics, self._lens, self._last = intrinsics, lens, None
        self._pinhole = oversampled(lens.pinhole, self._times)
        size = (self._pinhole.width, self._pinhole.height)
        if self._fine is None or self._fine.size != size:
            with self._canvas.context:
                if self._fine is not None:
                    release(self._fine)
                self._fine = self._canvas.target(size)

    def _load(self, scene: LitScene) -> None:
        canvas = self._canvas
        self._scene = scene
        self._atlas = Atlas(scene.surfaces)
        self._light_map = canvas.context.texture(self._atlas.size, 4, dtype="f2")
        self._light_map.repeat_x = self._light_map.repeat_y = False
        self._still = [
            Meshes(canvas, packed)
            for packed in (pack_parts(scene.parts), pack_surfaces(scene.surfaces, self._atlas.places))
            if packed.batches
        ]
        self._all = [(meshes, batch) for meshes in self._still for batch in meshes.packed.batches]
        self._corners = np.array([batch.corners for _, batch in self._all]).reshape(-1, 8, 3)
        self._walls = self._still[-1] if scene.surfaces else None
        self._near_batch: dict[int, tuple[list[AreaLight], list[tuple[float, ...]]]] = {}
        self._moving: dict[int, tuple[Mesh, Meshes]] = {}
        self._small = canvas.target(_WALLS_PX, 0)
        self._sheet = canvas.target(
            (silhouettes.TILE_PX * silhouettes.COLUMNS, silhouettes.TILE_PX * silhouettes.ROWS), 1, depth=False
        )
        self._batches_of: dict[int, list[Batch]] = {}
        for batch in self._still[0].packed.batches if scene.parts else ():
            self._batches_of.setdefault(batch.id, []).append(batch)
        self._outlines = silhouettes.Outlines(_points_by_id(self._still[:1]) if scene.parts else {})

    def frame(
        self,
        view: View,
        light: LightMix = LightMix(),  # noqa: B008 (frozen)
        exposure: float | None = None,
        movers: Iterable[Mover] = (),
    ) -> Frame:
        """Picture, ids and depth in one go; the latest frame is kept, asking for it again costs nothing."""
        movers = tuple(movers)
        exposure = self.exposure if exposure is None else exposure
        key = (view, light, exposure, movers)
        if self._last is None or self._last[0] != key:
            with self._canvas.context:
                self._last = key, self._drawn(view, light, exposure, movers)
        return self._last[1]

    def picture(
        self,
        view: View,
        light: LightMix = LightMix(),  # noqa: B008 (frozen)
        exposure: float | None = None,
        movers: Iterable[Mover] = (),
    ) -> NDArray[np.uint8]:
        """The picture, (H, W, 3) uint8 BGR, anti-aliased."""
        return self.frame(view, light, exposure, movers).picture

    def ids_and_depth(
        self, view: View, movers: Iterable[Mover] | None = None
    ) -> tuple[NDArray[np.int32], NDArray[np.float32]]:
        """Object ids (H, W), ROOM_ID for the room, and optical depth (H, W) in metres, both at pixel centres.

        movers: None takes those of the latest picture of this same view, if that was the latest.
        """
        if self._last is not None and self._last[0][0] is view:
            last_view, light, exposure, before = self._last[0]
            frame = self.frame(last_view, light, exposure, before if movers is None else movers)
        else:
            frame = self.frame(view, movers=movers or ())
        return frame.ids, frame.depth_m

    def whole(
        self, view: View, ids: Sequence[int], movers: Iterable[Mover] = ()
    ) -> tuple[list[NDArray[np.float64]], NDArray[np.float64]]:
        """Per object its whole box, as if nothing hid it, cut by the picture: (x0, y0, x1, y1) px, pixel k covering
        k to k + 1; and the area in px, in and around the picture, that it would cover (before the lens bends it)."""
        with self._canvas.context:
            return self._whole(view, list(ids), {mover.id: mover for mover in movers})

    def visible_px(self, ids: NDArray[np.int32]) -> NDArray[np.float64]:
        """Area in px that each id covers in an id picture, index by id; comparable with `whole`'s areas."""
        area = self._lens.area_px
        return np.bincount(ids.ravel(), weights=None if area is None else area.ravel()).astype(np.float64)

    def silhouette_px(self, view: View, id_: int) -> float:
        """Pixels that an object alone would cover in a picture twice as wide and high (for what the border cuts)."""
        return float(self.whole(view, [id_])[1][0])

    def close(self) -> None:
        """Give the OpenGL context back."""
        self._canvas.close()

    def _drawn(self, view: View, light: LightMix, exposure: float, movers: tuple[Mover, ...]) -> Frame:
        clip = clip_matrix(view, self._pinhole)
        draws, names = self._visible(view, clip, movers)
        self._mix(light)
        self._fine.use()
        self._fine.clear(0.0, 0.0, 0.0, 0.0)
        self._canvas.context.enable_only(self._canvas.gl.DEPTH_TEST)
        for draw in draws:
            if not draw.batch.see_through:
                self._colour(draw, light, exposure, draw.slot / 255.0)
        self._shadows(clip, movers)
        self._see_through([draw for draw in draws if draw.batch.see_through], light, exposure)
        return self._read(names)

    def _visible(self, view: View, clip: Array, movers: tuple[Mover, ...]) -> tuple[list[_Draw], list[int]]:
        """What to draw, near ones first, and the id that each slot stands for."""
        seen, depth = in_view(self._corners, clip, self._walls_m(clip))
        seen = seen[np.argsort(depth[seen], kind="stable")]
        names, slots, draws = [ROOM_ID], {ROOM_ID: 0}, []
        for mover in movers:
            draws += self._placed(view, clip, mover, _slot(mover.id, names, slots))
        for index in seen:
            meshes, batch = self._all[index]
            draws.append(_Draw(meshes, batch, _slot(batch.id, names, slots), clip, view.position_home_m))
        return draws, names

    def _walls_m(self, clip: Array) -> NDArray[np.float32] | None:
        if self._walls is None:
            return None
        program = self._canvas.walls
        program["clip_home"].write(clip.T.astype("f4").tobytes())
        self._small.use()
        self._small.clear(depth=1.0)
        self._canvas.context.enable_only(self._canvas.gl.DEPTH_TEST)
        self._walls.array(program).render()
        return _metres(self._depth_of(self._small))

    def _placed(self, view: View, clip: Array, mover: Mover, slot: int) -> list[_Draw]:
        """A mover's batches, its light worked out for where it stands."""
        home_mover = mover.matrix_home_mover()
        meshes = self._moving_meshes(mover.mesh)
        rows = meshes.packed.vertices
        turn = home_mover[:3, :3]
        lamp, day = mid_air_light(
            self._scene.probes,
            rows["position"].astype(np.float64) @ turn.T + home_mover[:3, 3],
            rows["normal"][:, :3] / 127.0 @ turn.T,
        )
        rows["lamp_front"] = rows["lamp_back"] = lamp
        rows["day_front"] = rows["day_back"] = day
        meshes.vertices.write(rows.tobytes())
        eye = np.asarray(np.linalg.inv(home_mover) @ [*view.position_home_m, 1.0], dtype=np.float64)
        return [_Draw(meshes, batch, slot, clip @ home_mover, eye[:3], home_mover) for batch in meshes.packed.batches]

    def _moving_meshes(self, mesh: Mesh) -> Meshes:
        if id(mesh) not in self._moving:
            dark = [np.zeros(part.positions.shape, dtype=np.float32) for part in mesh.parts]
            packed = pack_parts([LitPart(1, part, d, d) for part, d in zip(mesh.parts, dark, strict=True)])
            # The mesh is kept too, so that its id stays its own.
            self._moving[id(mesh)] = mesh, Meshes(self._canvas, packed)
        return self._moving[id(mesh)][1]

    def _colour(self, draw: _Draw, light: LightMix, exposure: float, slot: float) -> None:
        batch, material = draw.batch, draw.batch.material
        program = self._canvas.program(batch.kind)
        glow = np.array(material.emission) * (light.day if material.group == "day" else light.lamp)
        values = {"eye": tuple(draw.eye), "glow": tuple(glow), "exposure": exposure, "slot": slot}
        values |= {"day": light.day, "lamp": light.lamp, "gloss": material.gloss}
        for name, value in values.items():
            uniform = program.get(name, None)
            if uniform is not None:
                uniform.value = value
        program["clip_home"].write(draw.clip.T.astype("f4").tobytes())
        if batch.kind.glossy:
            self._highlights(program, draw, light)
        if batch.kind.image:
            self._canvas.texture(material.texture).use(0)
        draw.meshes.array(program).render(vertices=batch.count, first=batch.first)

    def _highlights(self, program: Any, draw: _Draw, light: LightMix) -> None:
        """The lights nearest to a glossy batch, as it sees them."""
        near, places = self._near(draw.batch) if draw.home is None else self._near_moving(draw.batch, draw.home)
        powers = [tuple(lamp.radiance * (0.5 * _share(lamp, light))) for lamp in near]
        program["lamp_at"], program["lamp_power"] = places, [*powers, *[_NOWHERE] * (shaders.LAMPS - len(near))]

    def _near(self, batch: Batch) -> tuple[list[AreaLight], list[tuple[float, ...]]]:
        if id(batch) not in self._near_batch:
            self._near_batch[id(batch)] = self._near_moving(batch, np.eye(4))
        return self._near_batch[id(batch)]

    def _near_moving(self, batch: Batch, home: Array) -> tuple[list[AreaLight], list[tuple[float, ...]]]:
        """The nearest lights, and where they are for a batch that stands at `home` (4, 4), padded to LAMPS."""
        middle = (home @ [*batch.corners.mean(axis=0), 1.0])[:3]
        near = sorted(self._scene.lights, key=lambda lamp: float(np.linalg.norm(lamp.centre - middle)))
        near, local = near[: shaders.LAMPS], np.linalg.inv(home)
        places = [tuple((local @ [*lamp.centre, 1.0])[:3]) for lamp in near]
        return near, [*places, *[_NOWHERE] * (shaders.LAMPS - len(near))]

    def _shadows(self, clip: Array, movers: tuple[Mover, ...]) -> None:
        gl, context = self._canvas.gl, self._canvas.context
        context.enable(gl.BLEND)
        self._write(colour=True, slot=False, depth=False)
        for mover in movers:
            points = self._moving_meshes(mover.mesh).packed.vertices["position"]
            self._canvas.shadow(clip @ mover.matrix_home_mover(), stand(points))
        self._write(colour=True, slot=True)
        context.disable(gl.BLEND)

    def _write(self, colour: bool, slot: bool, depth: bool = True) -> None:
        """Choose what drawing changes; masks count from the next `use` on."""
        self._fine.color_mask, self._fine.depth_mask = (colour, colour, colour, slot), depth
        self._fine.use()

    def _see_through(self, draws: list[_Draw], light: LightMix, exposure: float) -> None:
        """Blended colours, far ones first; then their ids, which cannot be blended."""
        gl, context = self._canvas.gl, self._canvas.context
        context.enable(gl.BLEND)
        self._write(colour=True, slot=False)
        for draw in reversed(draws):
            self._colour(draw, light, exposure, draw.batch.material.opacity)
        context.disable(gl.BLEND)
        self._write(colour=False, slot=True)
        context.depth_func = "<="
        for draw in draws:
            self._colour(draw, light, exposure, draw.slot / 255.0)
        context.depth_func = "<"
        self._write(colour=True, slot=True)

    def _read(self, names: list[int]) -> Frame:
        size = (self._pinhole.height, self._pinhole.width)
        raw = np.frombuffer(self._fine.read(components=4, alignment=1), dtype=np.uint8).reshape(*size, 4)
        depth = self._depth_of(self._fine)
        small = raw if self._times == 1 else cv2.pyrDown(raw, dstsize=(self._lens.pinhole.width, size[0] // 2))
        colour = cv2.LUT(np.ascontiguousarray(small[..., :3]), shaders.DISPLAY)
        slots = self._lens.exact(raw[..., 3], self._times)
        exact = self._lens.exact(depth, self._times)
        return Frame(
            self._lens.colour(np.asarray(colour, dtype=np.uint8)),
            np.array(names, dtype=np.int32)[slots],
            _metres(exact),
        )

    def _depth_of(self, target: Any) -> NDArray[np.float32]:
        width, height = target.size
        raw = target.read(components=1, attachment=-1, dtype="f4", alignment=1)
        return np.frombuffer(raw, dtype=np.float32).reshape(height, width)

    def _mix(self, light: LightMix) -> None:
        if light != self._light:
            self._light_map.write(self._atlas.mixed(light).tobytes())
            self._light = light
        self._light_map.use(1)

    def _whole(
        self, view: View, ids: list[int], movers: dict[int, Mover]
    ) -> tuple[list[NDArray[np.float64]], NDArray[np.float64]]:
        pinhole = self._lens.pinhole
        clip = clip_matrix(view, pinhole)
        program = self._canvas.silhouette
        boxes, areas, px = [], np.zeros(len(ids)), silhouettes.TILE_PX
        for start in range(0, len(ids), silhouettes.COLUMNS * silhouettes.ROWS):
            some = ids[start : start + silhouettes.COLUMNS * silhouettes.ROWS]
            self._sheet.use()
            self._sheet.clear()
            self._canvas.context.enable_only(self._canvas.gl.NOTHING)
            windows = []
            for number, id_ in enumerate(some):
                ideal = self._outline(id_, view, movers)
                boxes.append(self._cut(ideal))
                windows.append(silhouettes.window(silhouettes.pixel_box(ideal, pinhole), pinhole))
                row, column = divmod(number, silhouettes.COLUMNS)
                self._sheet.viewport = (column * px, row * px, px, px)
                self._alone(program, silhouettes.zoomed(clip, windows[-1], pinhole), id_, movers)
            covered = silhouettes.filled(self._sheet.read(components=1, alignment=1), len(some))
            sides = np.array(windows).reshape(-1, 2, 2)
            areas[start : start + len(some)] = covered * np.prod(sides[:, 1] - sides[:, 0], axis=1)
        return boxes, areas

    def _outline(self, id_: int, view: View, movers: dict[int, Mover]) -> Array:
        """An object's outermost points at unit depth of the optical frame; the axis itself where it is behind."""
        if id_ in movers:
            home_mover = movers[id_].matrix_home_mover()
            points = self._moving_meshes(movers[id_].mesh).packed.vertices["position"].astype(np.float64)
            self._outlines.copy_of(id_, points @ home_mover[:3, :3].T + home_mover[:3, 3])
        ideal = silhouettes.ideal_points(view.to_optical(self._outlines.of(id_)))
        return ideal if len(ideal) else np.zeros((1, 2))

    def _cut(self, ideal: Array) -> NDArray[np.float64]:
        """The box of points at unit depth in the picture; points beside it are moved to where the lens is still known,
        which is outside of it."""
        intrinsics, pinhole = self.intrinsics, self._lens.pinhole
        focal, centre = np.array([pinhole.fx, pinhole.fy]), np.array([pinhole.cx, pinhole.cy])
        low, high = (np.zeros(2) - centre) / focal, (np.array([pinhole.width, pinhole.height]) - centre) / focal
        box = silhouettes.pixel_box(np.clip(ideal, low, high), intrinsics)
        return np.clip(box, 0.0, np.tile([intrinsics.width, intrinsics.height], 2).astype(np.float64))

    def _alone(self, program: Any, clip: Array, id_: int, movers: dict[int, Mover]) -> None:
        if id_ in movers:
            meshes = self._moving_meshes(movers[id_].mesh)
            clip, batches = clip @ movers[id_].matrix_home_mover(), meshes.packed.batches
        else:
            meshes, batches = self._still[0], self._batches_of.get(id_, [])
        program["clip_home"].write(clip.T.astype("f4").tobytes())
        for batch in batches:
            program["holes"] = batch.kind.holes
            if batch.kind.holes:
                self._canvas.texture(batch.material.texture).use(0)
            meshes.array(program).render(vertices=batch.count, first=batch.first)


def _slot(id_: int, names: list[int], slots: dict[int, int]) -> int:
    """The byte that stands for an id in this picture; when there are too many, what is farthest passes for room."""
    if id_ not in slots:
        if len(names) > _MOST_OBJECTS:
            return 0
        slots[id_] = len(names)
        names.append(id_)
    return slots[id_]


def _share(lamp: AreaLight, light: LightMix) -> float:
    return light.day if lamp.group == "day" else light.lamp


def _metres(depth: NDArray[np.float32]) -> NDArray[np.float32]:
    """Optical depth from a depth buffer's 0..1; FAR_M where nothing was drawn."""
    return np.float32(2.0 * FAR_M * NEAR_M) / (
        np.float32(FAR_M + NEAR_M) - (np.float32(2.0) * depth - np.float32(1.0)) * np.float32(FAR_M - NEAR_M)
    )


def _points_by_id(still: Sequence[Meshes]) -> dict[int, Array]:
    """Corners (N, 3) of every object."""
    points: dict[int, list[Array]] = {}
    for packed in (meshes.packed for meshes in still):
        for batch in packed.batches:
            used = np.unique(packed.indices[batch.first : batch.first + batch.count])
            points.setdefault(batch.id, []).append(packed.vertices["position"][used].astype(np.float64))
    return {id_: np.concatenate(some) for id_, some in points.items() if id_ != ROOM_ID}
