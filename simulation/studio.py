"""Renders each picture of a world independently: the view, lens and sensor effects, and the ground truth."""

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.camera.mount import Mount
from edgemap.geometry.se2 import SE2
from edgemap.simulation.apartment import furniture
from edgemap.simulation.camera.exposure import LightScript, gains
from edgemap.simulation.camera.film import encoded, sensed, shaken
from edgemap.simulation.camera.shutter import optical_twist
from edgemap.simulation.render.light import BakeSettings, bake
from edgemap.simulation.render.movers import Mover
from edgemap.simulation.render.renderer import Renderer
from edgemap.simulation.render.scene import LightMix, LitScene
from edgemap.simulation.render.view import View
from edgemap.simulation.robot.nodding import lean
from edgemap.simulation.truth import floor_labels, picture_boxes
from edgemap.simulation.world import World, build_scene

EXPOSURE = 1.9
FIRST_MOVER_ID = 10_000
# Interval over which the velocity at a picture is computed.
_MOMENT_S = 0.02


@dataclass(frozen=True, slots=True, eq=False)
class Shot:
    """One picture with its ground truth. picture: encoded as JPEG or PNG, see `suffix`. boxes: as in boxes.json.
    depth_m: (H, W), depth along the optical axis."""

    index: int
    picture: bytes
    suffix: str
    boxes: list[dict[str, Any]]
    depth_m: NDArray[np.float32]

    def decoded(self) -> NDArray[np.uint8]:
        """The picture, (H, W, 3) BGR."""
        return np.asarray(cv2.imdecode(np.frombuffer(self.picture, np.uint8), cv2.IMREAD_COLOR), dtype=np.uint8)


def lit_home(world: World, settings: BakeSettings | None = None) -> LitScene:
    """Builds the home of a world and bakes its light. This is slow, and needed only once for each world."""
    return bake(build_scene(world.apartment, world.home_seed), world.home_seed, settings)


def light_mix(script: LightScript, stamp_s: float) -> LightMix:
    """Shares of daylight and lamplight at one stamp."""
    day, lamp = script.at(stamp_s)
    return LightMix(float(day), float(lamp))


class Studio:
    """Renders the pictures of a world reproducibly, in any order. Raises SimulationError if OpenGL is missing."""

    def __init__(self, world: World, lit: LitScene) -> None:
        self._world = world
        self._renderer = Renderer(lit, world.camera.intrinsics)
        self._gains = gains(lit.probes, world.light, world.motion, world.stamps_s, world.effects.lag_s)
        # The renderer identifies a mesh by object identity.
        self._people = [furniture.piece(walker.model) for walker in world.walkers]

    def shoot(self, index: int) -> Shot:
        """Renders one picture in the order of a real camera: shake, light, shutter, noise, encoding."""
        world, effects = self._world, self._world.effects
        rng = np.random.default_rng([world.seed, index, 4])
        stamp_s = index / world.camera.rate_hz
        view, mount, velocity = self._view(stamp_s, rng)
        gain, movers = float(self._gains[index]), self._movers(stamp_s)
        frame = self._renderer.frame(view, light_mix(world.light, stamp_s), EXPOSURE * gain, movers)
        boxes = picture_boxes(self._renderer, frame, view, world.apartment, movers)
        lens = world.camera.intrinsics
        picture = sensed(frame, lens, optical_twist(velocity, mount), effects, gain, rng)
        return Shot(index, *encoded(picture, effects.jpeg_quality), boxes, frame.depth_m)

    def close(self) -> None:
        """Releases the OpenGL context."""
        self._renderer.close()

    def _movers(self, stamp_s: float) -> tuple[Mover, ...]:
        return tuple(
            Mover(number, mesh, SE2(*walker.motion.at(np.array([stamp_s]))[0]))
            for number, (mesh, walker) in enumerate(zip(self._people, self._world.walkers, strict=True), FIRST_MOVER_ID)
        )

    def floor_labels(self, index: int) -> NDArray[np.uint8]:
        """Floor and wall labels of one picture, (H, W), as in `simulation.floor_labels`."""
        world, stamp_s = self._world, index / self._world.camera.rate_hz
        view, _, _ = self._view(stamp_s, np.random.default_rng([world.seed, index, 4]))
        frame = self._renderer.frame(view, light_mix(world.light, stamp_s), EXPOSURE, self._movers(stamp_s))
        return floor_labels(frame, view, world.camera.intrinsics, world.apartment.plan.height_m)

    def _view(self, stamp_s: float, rng: np.random.Generator) -> tuple[View, Mount, NDArray[np.float64]]:
        """The view of the camera, its mount with the current shake, and the velocity of the base: forward and left,
        m/s, and yaw rate, rad/s."""
        world = self._world
        before, pose, after = world.motion.at(stamp_s + np.array([-0.5, 0.0, 0.5]) * _MOMENT_S)
        speed, (c, s) = (after - before) / _MOMENT_S, (np.cos(pose[2]), np.sin(pose[2]))
        velocity = np.array([c * speed[0] + s * speed[1], c * speed[1] - s * speed[0], speed[2]])
        mount = shaken(world.camera.mount, world.effects.shake_rad, velocity, rng)
        tilt = np.zeros(3) if world.tilts is None else world.tilts.at(np.array([stamp_s]))[0]
        return View.of_base(SE2(*pose), mount, lean(tilt), float(tilt[2])), mount, velocity
