"""Alignment of a map with the true objects: known motions and scales are undone, and nothing gets worse by it."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from edgemap.evaluation.map_alignment import aligned_figures, best_alignment
from edgemap.evaluation.objects import TrueObject, score_map
from edgemap.geometry.map_object import MapObject

ROOM = [
    ("chair", 0, 0), ("chair", 2, 0.5), ("chair", 5, 1), ("couch", 1, 3), ("bed", 6, 4), ("oven", 4, 5), ("vase", 3, 2),
]  # fmt: skip


def truth(room=ROOM):
    return [TrueObject(label, x, y, True, 50) for label, x, y in room]


def mapped(room=ROOM, yaw=0.0, shift=(0.0, 0.0), scale=1.0):
    """The room as a map with another origin, heading and scale shows it."""
    rotation = scale * np.array([[math.cos(yaw), -math.sin(yaw)], [math.sin(yaw), math.cos(yaw)]])
    places = [rotation @ np.array([x, y], dtype=float) + shift for _, x, y in room]
    return [
        MapObject(f"{label}-{row}", label, place, np.eye(2) * 0.01, 0.5, 0.9, 9, 1.0, 0.0, 1.0)
        for row, ((label, _, _), place) in enumerate(zip(room, places, strict=True))
    ]


def test_another_origin_and_heading_leave_the_shape():
    objects = mapped(yaw=0.7, shift=(3.0, -2.0))
    assert score_map(objects, truth())["f1"] < 0.3
    assert aligned_figures(objects, truth()) == {"f1_aligned": 1.0, "f1_scaled": 1.0, "scale": pytest.approx(1.0)}


def test_a_map_that_is_too_large_has_its_scale_stated():
    figures = aligned_figures(mapped(yaw=-0.4, shift=(1.0, 1.0), scale=1.3), truth())
    assert figures["f1_scaled"] == 1.0
    assert figures["scale"] == pytest.approx(1.3, abs=1e-3)
    assert figures["f1_aligned"] < 1.0  # the outer objects are 0.9 m too far out


def test_the_mirror_image_of_a_room_is_not_its_shape():
    mirrored = [(label, x, -y) for label, x, y in ROOM]
    assert aligned_figures(mapped(mirrored), truth())["f1_scaled"] < 0.7


def test_too_few_pairs_have_no_scale():
    few = ROOM[:4]
    figures = aligned_figures(mapped(few, scale=1.2), truth(few))
    assert (figures["f1_scaled"], figures["scale"]) == (1.0, None)


def test_empty_maps():
    nothing = {"f1_aligned": 0.0, "f1_scaled": 0.0, "scale": None}
    assert aligned_figures([], truth()) == nothing
    assert aligned_figures(mapped(), [])["f1_aligned"] == 0.0
    assert aligned_figures([], [])["f1_aligned"] is None


def test_what_was_hardly_seen_aligns_nothing():
    """The only couch counts in neither map, so the chairs alone decide."""
    seldom = [TrueObject("couch", 9.0, 9.0, True, 3), TrueObject("chair", 0, 0, True, 50), *truth(ROOM[1:3])]
    similar, count = best_alignment(mapped(ROOM[:4]), seldom, scales=False)
    assert count == 3
    assert abs(similar.factor - 1.0) < 1e-6
    assert abs(similar.shift) < 1e-6


def test_hundreds_of_objects_of_one_label_take_bounded_work():
    many = [("bed", 1.5 * (i % 15), 1.5 * (i // 15)) for i in range(200)]
    assert aligned_figures(mapped(many), truth(many))["f1_aligned"] == 1.0


@settings(max_examples=25)
@given(
    st.lists(st.tuples(st.sampled_from(["chair", "bed"]), st.floats(-4, 4), st.floats(-4, 4)), max_size=7), st.data()
)
def test_no_alignment_makes_a_map_worse(room, data):
    """The order holds as well: what may scale finds at least as many pairs as nothing at all."""
    noise = data.draw(st.lists(st.tuples(st.floats(-1, 1), st.floats(-1, 1)), min_size=len(room), max_size=len(room)))
    moved = [(label, x + dx, y + dy) for (label, x, y), (dx, dy) in zip(room, noise, strict=True)]
    objects, wanted = mapped(moved), truth(room)
    plain = score_map(objects, wanted)["objects_found"]
    assert best_alignment(objects, wanted, scales=False)[1] >= plain
    assert best_alignment(objects, wanted, scales=True)[1] >= plain
    figures = aligned_figures(objects, [*wanted, TrueObject("bed", 0.0, 0.0, True, 3)])
    least = score_map(objects, [*wanted, TrueObject("bed", 0.0, 0.0, True, 3)])["f1"]
    assert figures["f1_aligned"] is None or figures["f1_scaled"] >= figures["f1_aligned"] >= (least or 0.0)
