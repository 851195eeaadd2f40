"""A home with furniture moved: what is told is what happened, nothing else changed, nothing overlaps."""

import math

import cv2
import numpy as np
import pytest

from edgemap.geometry.se2 import SE2, wrap_angle
from edgemap.simulation.apartment.apartment import furnish, move_furniture
from edgemap.simulation.record import moved_record
from edgemap.simulation.world import Choices, draw_world

pytestmark = pytest.mark.usefixtures("furniture_catalogue")


@pytest.fixture(scope="module", params=[5, 8110])
def home(request):
    before = furnish(request.param)
    return before, *move_furniture(before, 3, np.random.default_rng(1))


def test_the_rest_stays_and_the_changes_are_told(home):
    before, after, changes = home
    old, new = ({item.id: item for item in rooms.furniture} for rooms in (before, after))
    assert len(changes.removed) == len(changes.moved) == 3
    assert set(old) - set(new) == {item.id for item in changes.removed}
    assert {id_ for id_ in new if new[id_] != old[id_]} == {was.id for was, _ in changes.moved}
    for was, now in changes.moved:
        assert (old[was.id], new[now.id]) == (was, now)
        assert (now.model, now.tint, now.label, now.z_m) == (was.model, was.tint, was.label, was.z_m)
    assert after.before is before


def test_moved_pieces_stand_free_and_far_from_their_like(home):
    before, after, changes = home
    for was, now in changes.moved:
        floor = now.footprint_home_m()
        for other in after.furniture:
            above = other.z_m < now.model.height_m - 1e-6
            if other.id != now.id and above:
                assert _shared_m2(floor, other.footprint_home_m()) < 1e-4
        assert any(
            room.x0 <= x <= room.x1 and room.y0 <= y <= room.y1
            for room in after.plan.rooms
            for x, y in [(now.pose_home_object.x_m, now.pose_home_object.y_m)]
        )
        for x0, y0, x1, y1 in (door.rectangle for door in after.plan.doorways):
            assert _shared_m2(floor, np.array([(x0, y0), (x1, y0), (x1, y1), (x0, y1)])) == 0.0
        for other in before.furniture:
            if other.label == was.label:
                apart = other.pose_home_object.inverse() @ now.pose_home_object
                assert math.hypot(apart.x_m, apart.y_m) > 1.0


def test_the_second_drive_keeps_camera_and_light_and_says_where_it_starts():
    before, after = draw_world(8110, 20), draw_world(8110, 20, Choices(moved=2))
    assert (after.home_seed, after.camera, after.light, after.effects) == (
        before.home_seed, before.camera, before.light, before.effects
    )  # fmt: skip
    assert moved_record(before) == {}
    record = moved_record(after)
    x_m, y_m, yaw_deg = record["start"]
    first, start = before.poses()[0], after.poses()[0]
    found = first @ SE2(x_m, y_m, math.radians(yaw_deg))
    assert (found.x_m, found.y_m) == pytest.approx((start.x_m, start.y_m), abs=1e-3)
    assert wrap_angle(found.yaw_rad - start.yaw_rad) == pytest.approx(0.0, abs=1e-4)
    assert [len(record[kind]) for kind in ("removed", "moved")] == [2, 2]
    for item in record["moved"]:
        assert math.dist(item["was_m"], item["is_m"]) > 1.0


def _shared_m2(a, b):
    return cv2.intersectConvexConvex(a.astype(np.float32), b.astype(np.float32))[0]
