"""Input of the renderer and the light baker: surfaces, solids with ids, and lamps, in one room frame (z up, metres)."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from edgemap.simulation.render.mesh import Array, LightGroup, Material, Mesh, Part, Tile, quad

ROOM_ID = 0
# Irradiance / pi (..., 6): three channels of the lamps, then three of the day, which are apart as light adds up.
Light = NDArray[np.float32]


@dataclass(frozen=True, slots=True, eq=False)
class Panel:
    """A flat rectangle. corner, u, v: (3,) metres; it faces u x v."""

    corner: Array
    u: Array
    v: Array

    @property
    def normal(self) -> Array:
        """Unit normal (3,)."""
        normal = np.cross(self.u, self.v)
        return normal / np.linalg.norm(normal)


@dataclass(frozen=True, slots=True, eq=False)
class Surface(Panel):
    """A large rectangle of the room (floor, wall, ceiling, rug), lit by a light map. The texture repeats every `tile_m`
    along u and v."""

    material: Material
    tile_m: Tile = (1.0, 1.0)

    def part(self) -> Part:
        """The surface's two triangles."""
        return quad(self.corner, self.u, self.v, self.material, self.tile_m)

    def texels(self, spacing_m: float) -> tuple[int, int]:
        """Light map size (columns along u, rows along v)."""
        columns, rows = (max(2, round(float(np.linalg.norm(side)) / spacing_m)) for side in (self.u, self.v))
        return columns, rows


@dataclass(frozen=True, slots=True, eq=False)
class AreaLight(Panel):
    """A glowing rectangle. radiance: linear (3,). group: what it is switched with, the day outside or the lamps."""

    radiance: Array
    group: LightGroup = "lamp"

    @property
    def centre(self) -> Array:
        """Centre, (3,) metres."""
        return self.corner + (self.u + self.v) / 2.0


@dataclass(frozen=True, slots=True)
class LightMix:
    """Brightness of the two groups of lights, daylight and lamps, as factors on the baked light."""

    day: float = 1.0
    lamp: float = 1.0


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """All visible geometry and its lights. solids: meshes in place, lit at their vertices, by what the id picture
    shows of them; ROOM_ID for parts of the room itself."""

    surfaces: tuple[Surface, ...]
    solids: dict[int, Mesh]
    lights: tuple[AreaLight, ...]


@dataclass(frozen=True, slots=True, eq=False)
class LitPart:
    """A part of a solid with light kept at its corners, (T, 3, 6) on the front (where the normals point) and back."""

    id: int
    part: Part
    front: Light
    back: Light


class LitSurface(NamedTuple):
    """A surface with its light map (rows, columns, 6), row 0 at v = 0."""

    surface: Surface
    light: Light


@dataclass(frozen=True, slots=True, eq=False)
class Probes:
    """Light in mid-air, for what moves: (X, Y, Z, 6, 6) through the faces +x -x +y -y +z -z of small cubes. The first
    one is at `corner_m`, the next `step_m` (3,) on."""

    corner_m: Array
    step_m: Array
    light: Light


@dataclass(frozen=True, slots=True, eq=False)
class LitScene:
    """A scene with its baked light."""

    surfaces: tuple[LitSurface, ...]
    parts: tuple[LitPart, ...]
    lights: tuple[AreaLight, ...]
    probes: Probes
