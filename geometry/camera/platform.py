"""What a camera rides on: one choice that all estimators of motion, tilt and mount read."""

from enum import StrEnum


class Platform(StrEnum):
    """robot: on wheels or carried, in rooms. car: on a road, as in KITTI."""

    ROBOT = "robot"
    CAR = "car"

    @property
    def unit_m(self) -> float:
        """Unit of length, metres, in which noise and priors of odometries are stated: about the distance to the nearest
        floor in view."""
        return 8.0 if self is Platform.CAR else 1.0

    @property
    def in_room(self) -> bool:
        """Whether straight edges are those of a room, upright or along two directions, a floor head (trained on rooms)
        knows the floor, and corners are refined by detail."""
        return self is Platform.ROBOT
