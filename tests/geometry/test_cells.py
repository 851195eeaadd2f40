"""Places by cells of a grid against a search through all of them."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from edgemap.geometry.objects.cells import Cells


@given(st.integers(0, 2**32 - 1), st.floats(0, 4))
def test_whatever_moved_and_left_those_within_reach_are_found(seed, reach_m):
    random = np.random.default_rng(seed)
    cells, places = Cells[int](), {}
    for key in random.integers(0, 99, 200).tolist():
        if key in places and random.random() < 0.3:
            cells.remove(key)
            del places[key]
        else:
            places[key] = random.uniform(-5.0, 5.0, 2)
            cells.set(key, places[key])
    at = random.uniform(-2.0, 2.0, 2)
    far_m = {key: np.linalg.norm(place - at) for key, place in places.items()}
    found = cells.within(at, reach_m)
    assert len(cells) == len(places)
    assert len(found) == len(set(found))
    assert {key for key, m in far_m.items() if m < reach_m - 1e-9} <= set(found)
    assert set(found) <= {key for key, m in far_m.items() if m < reach_m + 1e-9}
