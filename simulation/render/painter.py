"""Colour passes: solid objects, shadows on the floor, then transparent ones; highlights on glossy surfaces."""

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from edgemap.simulation.render.canvas import LAMPS, Draw, RenderTarget
from edgemap.simulation.render.mesh import Array, LightGroup
from edgemap.simulation.render.scene import AreaLight, LightMix

_NOWHERE = (0.0, 0.0, 0.0)
_Place = tuple[float, ...]


class Painter:
    """Draws colours, with the slots of the ids in the fourth byte, and depths. lights: of the home."""

    def __init__(self, canvas: RenderTarget, lights: Sequence[AreaLight]) -> None:
        self._canvas, self._lights = canvas, lights
        self._near_batch: dict[int, tuple[list[AreaLight], list[_Place]]] = {}

    def paint(
        self,
        target: Any,
        draws: Sequence[Draw],
        shadows: Iterable[tuple[Array, _Place]],
        light: LightMix,
        exposure: float,
    ) -> None:
        """Fill a framebuffer. draws: near ones first; shadows: clip matrices and places for `Canvas.shadow`."""
        target.use()
        target.clear(0.0, 0.0, 0.0, 0.0)
        self._canvas.context.enable_only(self._canvas.gl.DEPTH_TEST)
        for draw in draws:
            if not draw.batch.material.see_through:
                self._colour(draw, light, exposure, draw.slot / 255.0)
        self._shadows(target, shadows)
        self._see_through(target, [draw for draw in draws if draw.batch.material.see_through], light, exposure)

    def _shadows(self, target: Any, shadows: Iterable[tuple[Array, _Place]]) -> None:
        gl, context = self._canvas.gl, self._canvas.context
        context.enable(gl.BLEND)
        _write(target, colour=True, slot=False, depth=False)
        for clip, place in shadows:
            self._canvas.shadow(clip, place)
        _write(target, colour=True, slot=True)
        context.disable(gl.BLEND)

    def _see_through(self, target: Any, draws: list[Draw], light: LightMix, exposure: float) -> None:
        """Blended colours, far ones first; then their ids, which cannot be blended."""
        gl, context = self._canvas.gl, self._canvas.context
        context.enable(gl.BLEND)
        _write(target, colour=True, slot=False)
        for draw in reversed(draws):
            self._colour(draw, light, exposure, draw.batch.material.opacity)
        context.disable(gl.BLEND)
        _write(target, colour=False, slot=True)
        context.depth_func = "<="
        for draw in draws:
            self._colour(draw, light, exposure, draw.slot / 255.0)
        context.depth_func = "<"
        _write(target, colour=True, slot=True)

    def _colour(self, draw: Draw, light: LightMix, exposure: float, slot: float) -> None:
        batch, material = draw.batch, draw.batch.material
        program = self._canvas.program(batch.needs)
        glow = np.array(material.emission) * _share(material.group, light)
        values = {"eye": tuple(draw.eye), "glow": tuple(glow), "exposure": exposure, "slot": slot}
        values |= {"day": light.day, "lamp": light.lamp, "gloss": material.gloss}
        for name, value in values.items():
            uniform = program.get(name, None)
            if uniform is not None:
                uniform.value = value
        program["clip_home"].write(draw.clip.T.astype("f4").tobytes())
        if "GLOSSY" in batch.needs:
            self._highlights(program, draw, light)
        if "IMAGE" in batch.needs:
            self._canvas.texture(material.texture).use(0)
        draw.meshes.array(program).render(vertices=batch.count, first=batch.first)

    def _highlights(self, program: Any, draw: Draw, light: LightMix) -> None:
        """The lights nearest to a glossy batch, as it sees them; those that are switched off cost nothing."""
        near, places = self._near(draw)
        on = [(lamp, at) for lamp, at in zip(near, places, strict=True) if _share(lamp.group, light) > 0.0]
        none = [_NOWHERE] * (LAMPS - len(on))
        program["lamps"] = len(on)
        program["lamp_at"] = [at for _, at in on] + none
        program["lamp_power"] = [tuple(lamp.radiance * (0.5 * _share(lamp.group, light))) for lamp, _ in on] + none

    def _near(self, draw: Draw) -> tuple[list[AreaLight], list[_Place]]:
        """The nearest lights, and where they are in the frame of the batch; worked out once for what never moves."""
        key = id(draw.batch)
        if draw.home is not None or key not in self._near_batch:
            home = np.eye(4) if draw.home is None else draw.home
            middle, local = (home @ [*draw.batch.corners.mean(axis=0), 1.0])[:3], np.linalg.inv(home)
            near = sorted(self._lights, key=lambda lamp: float(np.linalg.norm(lamp.centre - middle)))[:LAMPS]
            self._near_batch[key] = near, [tuple((local @ [*lamp.centre, 1.0])[:3]) for lamp in near]
        return self._near_batch[key]


def _write(target: Any, colour: bool, slot: bool, depth: bool = True) -> None:
    """Choose what drawing changes; masks count from the next `use` on."""
    target.color_mask, target.depth_mask = (colour, colour, colour, slot), depth
    target.use()


def _share(group: LightGroup, light: LightMix) -> float:
    return light.day if group == "day" else light.lamp
