"""Views for training: those that are to be close see less of the floor, and the others stay as they are."""

import numpy as np

from edgemap.simulation.apartment.apartment import furnish
from edgemap.simulation.robot.plan_grid import PlanGrid
from edgemap.simulation.views import draw_views


def ahead_m(grid, view):
    """How far the floor is free straight ahead."""
    pose, steps = view.pose_home_base, np.arange(0.0, 12.0, 0.02)
    points = np.array([pose.x_m, pose.y_m]) + steps[:, None] * [np.cos(pose.yaw_rad), np.sin(pose.yaw_rad)]
    return steps[np.argmax(grid.tops_m[grid.cells_of(points)] > 0.0)]


def test_close_views_have_less_floor_ahead_and_leave_the_others_alone():
    home = furnish(3)
    usual, mixed = draw_views(home, 3, 8), draw_views(home, 3, 8, close=0.5)
    grid = PlanGrid(home)
    assert [view.pose_home_base for view in mixed[:4]] == [view.pose_home_base for view in usual[:4]]
    assert [view.camera for view in mixed] == [view.camera for view in usual]
    near, far = ([ahead_m(grid, view) for view in views[4:]] for views in (mixed, usual))
    assert np.median(near) < 0.5 * np.median(far)
