"""A piece of furniture in place."""

from dataclasses import dataclass

from edgemap.geometry.se2 import SE2
from edgemap.simulation.apartment.furniture import Model
from edgemap.simulation.apartment.tint import Tint
from edgemap.simulation.render.mesh import Array

# What walks away: detected, but never mapped, and nothing that a home must offer.
ALIVE = frozenset({"person", "cat", "dog"})


@dataclass(frozen=True, slots=True)
class Placed:
    """A piece of furniture in place. id: from 1, unique in the home. label: a COCO class, or "" for mere decoration.

    model: at this piece's own size. pose_home_object: origin at the footprint's centre, x out of the front. z_m: height
    above the floor. kind: its name in models.toml.
    """

    id: int
    label: str
    model: Model
    pose_home_object: SE2
    z_m: float = 0.0
    tint: Tint | None = None
    kind: str = ""

    @property
    def on_floor(self) -> bool:
        """True where it stands on the floor rather than on other furniture or a wall."""
        return self.z_m < 0.02

    def footprint_home_m(self) -> Array:
        """Corners (4, 2) of its oriented bounding rectangle, counter-clockwise."""
        x, y = self.model.depth_m / 2.0, self.model.width_m / 2.0
        return self.pose_home_object.apply([[x, -y], [x, y], [-x, y], [-x, -y]])
