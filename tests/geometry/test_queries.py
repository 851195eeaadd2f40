import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from edgemap.geometry.errors import MapError
from edgemap.geometry.map_object import MapObject
from edgemap.geometry.objects.queries import inside_polygon, nearest


def item(identity, x, y, last_s=1.0):
    label = identity.rpartition("-")[0]
    return MapObject(identity, label, np.array([x, y], float), np.eye(2), 0.5, 0.9, 9, 1.0, 0.0, last_s)


ROOM = [item("chair-1", 3, 0, 5.0), item("couch-1", 1, 1, 9.0), item("chair-2", -1, 0, 7.5)]


def ids(objects):
    return [found.id for found in objects]


def test_nearest_first_with_distances():
    found = nearest(ROOM, (0, 0))
    assert [(round(distance, 6), found.id) for distance, found in found] == [
        (1.0, "chair-2"),
        (1.414214, "couch-1"),
        (3.0, "chair-1"),
    ]
    assert [found.id for _, found in nearest(ROOM, (4, 0), "chair", count=1)] == ["chair-1"]
    assert nearest(ROOM, (0, 0), "bed") == []


def test_a_polygon_with_a_notch():
    """An L: the notch at its upper right is outside, its sides and corners are inside, either way round."""
    corners = [(0, 0), (4, 0), (4, 2), (2, 2), (2, 4), (0, 4)]
    objects = [item("a-1", 1, 3), item("b-1", 3, 3), item("c-1", 4, 1), item("d-1", 2, 2), item("e-1", -0.01, 1)]
    assert ids(inside_polygon(objects, corners)) == ["a-1", "c-1", "d-1"]
    assert ids(inside_polygon(objects, corners[::-1])) == ["a-1", "c-1", "d-1"]


coordinate = st.floats(-10, 10)


@given(st.lists(st.tuples(coordinate, coordinate), min_size=3, max_size=3), coordinate, coordinate)
def test_a_triangle_holds_what_its_three_sides_agree_on(corners, x, y):
    (a, b, c), point = np.array(corners), np.array([x, y])

    def side(p, q):
        return (q[0] - p[0]) * (point[1] - p[1]) - (q[1] - p[1]) * (point[0] - p[0])

    signs = [side(a, b), side(b, c), side(c, a)]
    if min(abs(value) for value in signs) < 1e-6:
        return  # on a side's line: decided by rounding
    expected = all(value > 0 for value in signs) or all(value < 0 for value in signs)
    assert bool(inside_polygon([item("a-1", x, y)], corners)) == expected


@pytest.mark.parametrize("corners", [[(0, 0), (1, 1)], [(0, 0, 0)] * 3, [(0, 0), (1, float("nan")), (2, 2)]])
def test_what_is_no_polygon_is_refused(corners):
    with pytest.raises(MapError, match="three corners"):
        inside_polygon(ROOM, corners)
