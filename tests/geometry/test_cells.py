"""Places by cells of a grid against a search through all of them."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from edgemap.geometry.objects.cells import Cells

PLACES = st.lists(st.tuples(st.integers(0, 9), st.floats(-8, 8), st.floats(-8, 8), st.booleans()), max_size=40)


@given(PLACES, st.floats(-8, 8), st.floats(-8, 8), st.floats(0, 6))
def test_whatever_moved_and_left_those_within_reach_are_found(changes, x, y, reach_m):
    cells, places = Cells[int](), {}
    for key, *place, leaves in changes:
        if leaves and key in places:
            cells.remove(key)
            del places[key]
        else:
            cells.set(key, np.array(place))
            places[key] = np.array(place)
    far_m = {key: np.linalg.norm(place - [x, y]) for key, place in places.items()}
    found = cells.within(np.array([x, y]), reach_m)
    assert len(cells) == len(places)
    assert len(found) == len(set(found))
    assert {key for key, m in far_m.items() if m < reach_m - 1e-9} <= set(found)
    assert set(found) <= {key for key, m in far_m.items() if m < reach_m + 1e-9}
