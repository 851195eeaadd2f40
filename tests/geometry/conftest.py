import numpy as np
import pytest

from edgemap.geometry.observations.sighting import PlacedSighting, Sighting
from edgemap.geometry.se2 import SE2


def _placed(label, x_m, y_m, frame, sigma_m=0.08, score=0.8, shared_m=0.03):
    sighting = Sighting(
        label, score, np.array([x_m, y_m]), np.eye(2) * sigma_m**2, np.eye(2) * shared_m**2,
        0.5, 0.9, 0.5, 2.0, 0, frame, frame / 10.0,
    )  # fmt: skip
    return PlacedSighting(sighting, SE2(), np.zeros((3, 3)))


@pytest.fixture(scope="session")
def placed_():
    """`placed` for hypothesis, which wants no fixture made anew for every test."""
    return _placed


@pytest.fixture
def placed():
    """A maker of sightings at known places of the map: placed(label, x_m, y_m, frame, ...)."""
    return _placed
