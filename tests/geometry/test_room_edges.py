import numpy as np
import pytest

from edgemap.geometry.camera.room_edges import level_axes, room_heading

UP = np.array([0.0, -1.0, 0.0])  # of a level camera, optical frame


@pytest.mark.parametrize("heading_deg", [0.0, 0.3, 45.0, 89.7])
def test_edges_to_either_side_of_a_heading_agree_on_it(heading_deg):
    """Six edges a degree to one side, four to the other; the heading repeats at right angles."""
    right, away = level_axes(UP)
    angles = np.radians(heading_deg + np.array([-1.0] * 6 + [1.0] * 4) + 90.0 * np.arange(10))
    along = np.outer(np.cos(angles), right) + np.outer(np.sin(angles), away)
    normals = (UP + np.cross(UP, along)) / np.sqrt(2.0)  # of planes through the lens and edges 45 degrees off
    found = np.degrees(room_heading(normals, np.ones(10), UP))
    assert abs((found - heading_deg + 45.0) % 90.0 - 45.0) < 0.8
