"""What a person has set of an object: read back from a saved one, and changed in parts."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.rooms import mapped

from edgemap.geometry.objects.corrections import Correction

METRES = st.floats(0.1, 5.0)
CORRECTIONS = st.builds(
    Correction, st.sampled_from(["", "bench", "couch"]), st.none() | st.tuples(METRES, METRES),
    st.none() | st.tuples(METRES, METRES, METRES), st.none() | st.floats(-3.0, 3.0), st.none() | st.floats(0.0, 9.0),
)  # fmt: skip
(CHAIR,) = mapped([("chair", 1.0, 2.0)])


@given(CORRECTIONS)
def test_what_was_set_is_read_back_from_the_object_and_the_rest_stays_measured(correction):
    item = correction.apply(CHAIR)
    assert Correction.of(item) == replace(correction, anchor_s=None)
    assert item.label == (correction.label or "chair")
    assert item.position_m.tolist() == list(correction.place_m or (1.0, 2.0))
    measured = (CHAIR.width_m, CHAIR.depth_m, CHAIR.height_m)
    assert (item.width_m, item.depth_m, item.height_m) == (correction.size_m or measured)
    assert item.yaw_rad == correction.yaw_rad
    if correction.place_m is None:
        np.testing.assert_array_equal(item.covariance_m2, CHAIR.covariance_m2)


@given(CORRECTIONS, CORRECTIONS)
def test_a_newer_correction_changes_what_it_sets_and_nothing_else(older, newer):
    found = older.updated(newer)
    for name in ("label", "place_m", "size_m", "yaw_rad"):
        unset = getattr(newer, name) in ("", None)
        assert getattr(found, name) == getattr(older if unset else newer, name)
    assert found.anchor_s == (older if newer.place_m is None else newer).anchor_s  # of the pose beside the place


def test_a_place_set_to_nought_degrees_faces_forward():
    turned = Correction(yaw_rad=1.0).updated(Correction(yaw_rad=0.0))
    assert turned.apply(CHAIR).yaw_rad == pytest.approx(0.0, abs=0.0)
