"""What stands in objects.json: the furniture of the map, and not those who walk away."""
# pyright: reportArgumentType=false

import numpy as np
import pytest
from support.hand_made_home import PIECES, home

from edgemap.geometry.se2 import SE2
from edgemap.simulation.apartment.apartment import Apartment
from edgemap.simulation.apartment.furniture import Model
from edgemap.simulation.apartment.layout import Placed
from edgemap.simulation.camera.film import CameraSetup
from edgemap.simulation.robot.plan_grid import PlanGrid, VisibilityEstimate
from edgemap.simulation.truth import object_records

MODEL = Model("Scopia", "thing", "somebody", "thing.obj", 0.6, 0.4, 0.9)


def placed(number, label, x_m=3.0, y_m=2.0, yaw_rad=0.0, z_m=0.0):
    return Placed(number, label, MODEL, SE2(x_m, y_m, yaw_rad), z_m)


def seen(number, visible=0.8, side_px=30):
    return {"id": number, "box": [10, 20, 10 + side_px, 30], "visible": visible}


def test_objects_are_told_in_the_frame_of_the_first_pose():
    """From (1, 2) looking along y, a chair at (0, 5) is 3 m ahead and 1 m to the left, turned back by a quarter."""
    (record,) = object_records(
        Apartment(None, (placed(7, "chair", 0.0, 5.0),)),
        SE2(1.0, 2.0, np.pi / 2),
        [[seen(7)], [seen(7, visible=0.2)], [seen(7, side_px=20)], [], [seen(7, visible=0.3, side_px=24)]],
    )
    assert (record["id"], record["label"], record["on_floor"]) == (7, "chair", True)
    assert (record["x_m"], record["y_m"]) == pytest.approx((3.0, 1.0))
    assert (record["width_m"], record["depth_m"], record["height_m"]) == (0.6, 0.4, 0.9)
    # 0.4 m deep along the home's x, which is the map's -y; 0.6 m wide along the home's y, the map's x.
    assert np.ptp(record["footprint_m"], axis=0) == pytest.approx([0.6, 0.4])
    assert record["visible_frames"] == 2


def test_people_and_pets_are_no_objects_of_the_map():
    labels = ("person", "chair", "cat", "dog", "", "tv")
    furniture = tuple(placed(number, label, z_m=0.5 * (label == "tv")) for number, label in enumerate(labels, 1))
    records = object_records(Apartment(None, furniture), SE2(0.0, 0.0, 0.0), [])
    assert [(record["label"], record["on_floor"]) for record in records] == [("chair", True), ("tv", False)]


def test_a_drive_is_not_chosen_for_the_people_and_pets_in_view():
    """What the contract counts comes from `VisibilityEstimate`: the cat on the carpet is none of it."""
    flat = home((*PIECES, ("cat", 3.0, 1.8, 0.2, 0.4, 0.3, 0.0), ("person", 1.2, 2.0, 0.5, 0.4, 1.7, 0.0)))
    camera = CameraSetup()
    sight = VisibilityEstimate(flat, PlanGrid(flat), camera.intrinsics, camera.mount)
    assert sight.ids.tolist() == list(range(1, 10))
