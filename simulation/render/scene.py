"""Input of the renderer and the light baker: surfaces, solids with ids, and lamps, in one room frame (z up, metres)."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from edgemap.simulation.render.mesh import Array, LightGroup, Material, Mesh, Part, Tile, quad

ROOM_ID = 0


@dataclass(frozen=True, slots=True, eq=False)
class Surface:
    """A large rectangle of the room (floor, wall, ceiling, rug), lit by a light map.

    corner, u, v: (3,) metres; it faces u x v. The texture repeats every `tile_m` along each.
    """

    corner: Array
    u: Array
    v: Array
    material: Material
    tile_m: Tile = (1.0, 1.0)

    @property
    def normal(self) -> Array:
        """Unit normal (3,)."""
        normal = np.cross(self.u, self.v)
        return normal / np.linalg.norm(normal)

    def part(self) -> Part:
        """The surface's two triangles."""
        return quad(self.corner, self.u, self.v, self.material, self.tile_m)

    def texels(self, spacing_m: float) -> tuple[int, int]:
        """Light map size (columns along u, rows along v)."""
        columns, rows = (max(2, round(float(np.linalg.norm(side)) / spacing_m)) for side in (self.u, self.v))
        return columns, rows


@dataclass(frozen=True, slots=True, eq=False)
class Solid:
    """A mesh in place, lit at its vertices. id: what the id picture shows; ROOM_ID for parts of the room itself."""

    id: int
    mesh: Mesh


@dataclass(frozen=True, slots=True, eq=False)
class AreaLight:
    """A glowing rectangle: corner, u, v (3,) metres, shining along u x v; radiance: linear (3,).

    group: what it is switched with, the day outside or the lamps.
    """

    corner: Array
    u: Array
    v: Array
    radiance: Array
    group: LightGroup = "lamp"

    @property
    def normal(self) -> Array:
        """Unit direction it shines in, (3,)."""
        normal = np.cross(self.u, self.v)
        return normal / np.linalg.norm(normal)

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
    """All visible geometry and its lights."""

    surfaces: tuple[Surface, ...]
    solids: tuple[Solid, ...]
    lights: tuple[AreaLight, ...]


@dataclass(frozen=True, slots=True, eq=False)
class LitPart:
    """A part of a solid with light kept at its corners: irradiance / pi (T, 3, 3) on the front (where the normals
    point) and on the back. front, back: of the lamps; day_front, day_back: of the day."""

    id: int
    part: Part
    front: NDArray[np.float32]
    back: NDArray[np.float32]
    day_front: NDArray[np.float32]
    day_back: NDArray[np.float32]


class LitSurface(NamedTuple):
    """A surface with its light maps (rows, columns, 3) float32 irradiance / pi, row 0 at v = 0: lamps, then day."""

    surface: Surface
    lamp: NDArray[np.float32]
    day: NDArray[np.float32]


@dataclass(frozen=True, slots=True, eq=False)
class Probes:
    """Light in mid-air, for what moves. irradiance / pi through the six faces of a small cube.

    lamp, day: (X, Y, Z, 6, 3), faces +x -x +y -y +z -z; the first probe is at `corner_m`, the next `step_m` (3,) on.
    """

    corner_m: Array
    step_m: Array
    lamp: NDArray[np.float32]
    day: NDArray[np.float32]


@dataclass(frozen=True, slots=True, eq=False)
class LitScene:
    """A scene with its baked light, apart for lamps and day, as light adds up."""

    surfaces: tuple[LitSurface, ...]
    parts: tuple[LitPart, ...]
    lights: tuple[AreaLight, ...]
    probes: Probes
