"""Two maps as one: objects, a person's statements, and ten maps of one home (`pytest -s` prints the figures)."""

import json
import math
from dataclasses import dataclass, replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.rooms import furnished, mapped, somewhere

from edgemap.geometry.objects.annotations import NO_ANNOTATIONS, Annotations, MapIdentity, Zone
from edgemap.geometry.objects.merge import fused, merge_all, merge_annotated, merge_maps, moved
from edgemap.geometry.registration.alignment import Alignment, align
from edgemap.geometry.se2 import SE2
from edgemap.geometry.slam.object_landmarks import LandmarkRule
from edgemap.runtime.step.map_file import map_document, read_map

SURE = LandmarkRule(side_share=0.0)
SYSTEMATIC = LandmarkRule(side_share=0.16 * math.sqrt(2.0))  # 0.08 m from one side of a chair of 0.5 m


def laid(pose, pairs, covariance=None):
    covariance = np.zeros((3, 3)) if covariance is None else covariance
    return Alignment(pose, covariance, pairs, len(pairs), 0, 0.0, 0.0)


def test_positions_counts_and_sizes_of_both_maps():
    near, far = mapped([("chair", 0.0, 0.0)])[0], mapped([("chair", 0.3, 0.6)])[0]
    near = replace(near, covariance_m2=np.diag([0.02, 0.04]))
    far = replace(far, covariance_m2=np.diag([0.04, 0.02]))
    chair = fused(near, far, SURE)
    assert chair.position_m == pytest.approx([0.1, 0.4])  # x two parts to one, y one to two
    assert chair.covariance_m2 == pytest.approx(np.diag([1 / 75, 1 / 75]))
    item = replace(mapped([("chair", 0.0, 0.0)])[0], covariance_m2=np.eye(2) * 0.0464)
    chair = fused(item, item, SYSTEMATIC)  # 0.08 m: 0.0064 stays, 0.04 is halved
    assert chair.covariance_m2 == pytest.approx(np.eye(2) * 0.0264)
    sure = replace(item, covariance_m2=np.eye(2) * 0.004)
    twice = fused(sure, sure, SYSTEMATIC)
    assert twice.covariance_m2 == pytest.approx(np.eye(2) * 0.004)  # never less sure than the surer map
    ours = replace(mapped([("chair", 0.0, 0.0)])[0], count=30, width_m=0.4, first_seen_s=5.0, last_seen_s=9.0)
    theirs = replace(ours, id="chair-7", count=10, width_m=0.8, confidence=0.8, first_seen_s=2.0, last_seen_s=7.0)
    chair = fused(ours, theirs, LandmarkRule())
    assert (chair.id, chair.count, chair.first_seen_s, chair.last_seen_s) == ("chair-1", 40, 2.0, 9.0)
    assert chair.confidence == pytest.approx(0.98)
    assert chair.width_m == pytest.approx(0.5)


def test_ids_of_the_first_map_stay_and_taken_ones_get_the_next_number():
    first = mapped([("chair", 0.0, 0.0), ("chair", 2.0, 0.0)])
    second = mapped([("chair", 2.0, 0.0), ("chair", 5.0, 5.0), ("tv", 1.0, 1.0)])
    second[0] = replace(second[0], id="chair-9")
    merged, became = merge_maps(first, second, laid(SE2(), ((1, 0),)))
    assert became == {"chair-9": "chair-2", "chair-2": "chair-10", "tv-1": "tv-1"}
    assert [item.id for item in merged] == ["chair-1", "chair-2", "chair-10", "tv-1"]
    assert merged[2].position_m == pytest.approx([5.0, 5.0])


def test_what_would_stand_in_one_another_is_one_chair():
    """0.36 m apart at sigmas of 0.07 m: too far for the gate (chi2 13.2), too near for two chairs."""
    first, second = (mapped([("chair", x, 0.0), ("chair", 3.0, 0.0)]) for x in (0.0, 0.36))
    first, second = ([replace(o, covariance_m2=np.eye(2) * 0.0049, width_m=0.5) for o in m] for m in (first, second))
    merged, became = merge_maps(first, second, laid(SE2(), ((1, 1),)))
    assert became == {"chair-1": "chair-1", "chair-2": "chair-2"}
    assert merged[0].position_m == pytest.approx([0.18, 0.0])
    assert merged[0].covariance_m2[0, 0] > 0.18**2 / 2.0  # unsure of what the maps disagree about
    assert merged[1].covariance_m2[0, 0] < 0.005
    apart = mapped([("chair", 0.6, 0.0), ("chair", 3.0, 0.0)])
    assert len(merge_maps(first, apart, laid(SE2(), ((1, 1),)))[0]) == 3


def test_two_chairs_that_one_map_saw_side_by_side_stay_two():
    first = [replace(o, width_m=0.5) for o in mapped([("chair", 0.0, 0.0), ("chair", 0.34, 0.0)])]
    assert len(merge_maps(first, first, laid(SE2(), ((0, 0), (1, 1))))[0]) == 2
    assert len(merge_maps(first, first[:1], laid(SE2(), ((0, 0),)))[0]) == 2


def test_a_far_object_carries_the_alignments_turn():
    pose, covariance = SE2(1.0, 0.0, np.pi / 2), np.diag([0.0, 0.0, 0.01])
    item = replace(mapped([("chair", 3.0, 0.0)])[0], covariance_m2=np.diag([0.04, 0.01]))
    here = moved(item, laid(pose, (), covariance))
    assert here.position_m == pytest.approx([1.0, 3.0])
    assert here.covariance_m2 == pytest.approx(np.diag([0.01 + 0.09, 0.04]))  # 0.1 rad at 3 m is 0.3 m across


@given(st.integers(0, 10_000))
@settings(max_examples=20)
def test_merging_a_map_with_itself_moved_changes_no_place(seed):
    random = np.random.default_rng(seed)
    room = furnished(random, 14)
    motion = somewhere(random)
    first, second = mapped(room), mapped(room, motion)
    merged, _ = merge_maps(first, second, align(first, second))
    places = {item.id: item.position_m for item in merged}
    assert {item.id for item in first} == set(places)
    for item in first:
        assert places[item.id] == pytest.approx(item.position_m, abs=1e-6)
    for item in merged:
        assert np.linalg.eigvalsh(item.covariance_m2).min() > 0


STATED = ("label", "position", "size", "yaw")


def test_what_a_person_stated_of_an_object_survives_a_merge():
    bed, measured = mapped([("bed", 2.0, 0.0)])[0], mapped([("bed", 2.3, 0.1)])[0]
    bed = replace(
        bed, covariance_m2=np.eye(2) * 0.0025, width_m=1.6, height_m=0.8, depth_m=2.0, yaw_rad=1.0, corrected=STATED,
        name="my bed", confirmed=True, confidence=1.0, labels={"bed": 1.0},
    )  # fmt: skip
    turned = SE2(1.0, 2.0, math.pi / 2)
    for first, second, pose in (
        (bed, measured, SE2()), (measured, moved(bed, laid(turned.inverse(), ())), turned),
    ):  # fmt: skip
        (merged,), _ = merge_maps([first], [second], laid(pose, ((0, 0),)))
        assert (merged.name, merged.confirmed, merged.confidence) == ("my bed", True, 1.0)
        assert merged.corrected == STATED
        assert (merged.width_m, merged.height_m, merged.depth_m) == (1.6, 0.8, 2.0)
        assert merged.yaw_rad == pytest.approx(1.0)
        assert merged.position_m == pytest.approx(bed.position_m)
        assert merged.covariance_m2 == pytest.approx(bed.covariance_m2)
        assert merged.count == bed.count + measured.count


def test_each_statement_is_kept_for_itself_and_the_first_map_wins():
    ours, theirs = mapped([("chair", 0.0, 0.0)])[0], mapped([("chair", 0.1, 0.0)])[0]
    ours = replace(ours, corrected=("yaw",), yaw_rad=0.5)
    theirs = replace(theirs, corrected=("size", "yaw"), yaw_rad=2.0, width_m=0.7, depth_m=0.6, height_m=1.1)
    (merged,), _ = merge_maps([ours], [theirs], laid(SE2(), ((0, 0),)))
    assert (merged.corrected, merged.yaw_rad) == (("size", "yaw"), 0.5)
    assert (merged.width_m, merged.depth_m, merged.height_m) == (0.7, 0.6, 1.1)
    assert merged.position_m == pytest.approx([0.05, 0.0])


def test_deletions_zones_and_dock_of_both_maps_are_kept():
    room = [("chair", 0.0, 0.0), ("chair", 2.0, 0.0), ("tv", 1.0, 2.0), ("bed", 4.0, 4.0), ("couch", 6.0, 0.0)]
    first, second = mapped(room), mapped(room)
    there = SE2(1.0, 2.0, 0.5)
    here = laid(there, ((0, 1), (1, 2), (2, 3)))
    second = [moved(item, laid(there.inverse(), ())) for item in second]
    pieces = ((0.0, 0.0), (1.0, 0.0), (1.0, 1.0))
    ours = Annotations((Zone("zone-1", "hall", pieces),), (first[0],))
    theirs = Annotations((Zone("zone-1", "bath", pieces),), (second[4],), SE2(1.0, 0.0, 0.0))
    merged, annotations = merge_annotated((first[1:], ours), (second[:4], theirs), here)
    assert [item.id for item in merged] == ["bed-1", "chair-2", "tv-1"]  # each deletion holds for both maps
    assert sorted(item.id for item in annotations.deleted) == ["chair-1", "couch-1"]
    assert annotations.deleted[1].position_m == pytest.approx(first[4].position_m)
    assert [(zone.id, zone.name) for zone in annotations.zones] == [("zone-1", "hall"), ("zone-2", "bath")]
    assert annotations.dock.vector() == pytest.approx((there @ SE2(1.0, 0.0, 0.0)).vector())
    named = [replace(second[0], name="grandfather's"), *second[1:4]]
    merged, annotations = merge_annotated((first[1:], ours), (named, theirs), here)
    assert "grandfather's" in [item.name for item in merged]
    read_map(json.dumps(map_document(merged, annotations)).encode(), "the merged map")


def test_a_merged_map_is_no_better_than_either_and_a_reason_of_both_stands_once():
    one = MapIdentity("a", 3, level="care", reasons=("the lens is guessed",))
    two = MapIdentity("b", 1, level="unreliable", reasons=("the lens is guessed", "no floor was in view"))
    assert one.merged(two) == MapIdentity("a", 4, level="unreliable", reasons=(*one.reasons, "no floor was in view"))


NEAR_M = 0.5
HOMES = 1  # 8 for the figures of docs/fleet.md


@dataclass
class TenMaps:
    """What a merge of ten maps made. objects: merged; of the home's: with an object of its class within 0.5 m."""

    joined: set
    objects: int
    found: int
    duplicates: int
    errors_m: list


def ten_maps(seed, reach_m):
    """Each robot maps what stands within `reach_m` of a point of the home (12 x 8 m, 32 objects), misses 15 % of it,
    places it with 5 cm of noise and starts anywhere. The first in the mapping is of another home."""
    random = np.random.default_rng(seed)
    home, other = furnished(random, 32, (12.0, 8.0), 0.7), furnished(random, 24, (10.0, 8.0), 0.7)
    maps = {"another home": (mapped(other, somewhere(random), random, 0.05, 0.15), NO_ANNOTATIONS)}
    starts = {}
    for name in (f"robot{k}" for k in range(10)):
        middle, starts[name] = random.uniform((2, 2), (10, 6)), somewhere(random)
        part = [thing for thing in home if np.hypot(thing[1] - middle[0], thing[2] - middle[1]) < reach_m]
        maps[name] = (mapped(part, starts[name], random, 0.05, 0.15), NO_ANNOTATIONS)
    merged = merge_all(maps)
    first = next(iter(merged.alignments))
    matched, errors_m = [], []
    for item in merged.objects:
        place = starts[first].apply(item.position_m)
        like = [row for row, thing in enumerate(home) if thing[0] == item.label]
        distance_m, row = min((float(np.hypot(*(place - home[row][1:]))), row) for row in like)
        if distance_m < NEAR_M:
            matched.append(row)
            errors_m.append(distance_m)
    found = set(matched)
    return TenMaps(set(merged.alignments), len(merged.objects), len(found), len(matched) - len(found), errors_m)


@pytest.mark.parametrize("reach_m", [4.0, 5.0, 7.0])
def test_ten_maps_of_a_home_are_one_and_another_home_stays_out(reach_m):
    runs = [ten_maps(seed, reach_m) for seed in range(HOMES)]
    joined, errors_m = [len(run.joined) for run in runs], np.concatenate([run.errors_m for run in runs])
    objects, found, duplicates = (sum(getattr(run, one) for run in runs) for one in ("objects", "found", "duplicates"))
    print(
        f"\nreach {reach_m:g} m: {np.mean(joined):.2f} of 10 maps joined (at least {min(joined)}), {objects} objects, "
        f"{found} of {32 * len(runs)} true ones, {duplicates} twice, position error {np.median(errors_m):.3f} m "
        f"(median), {max(errors_m):.2f} m (largest)"
    )
    assert not any("another home" in run.joined for run in runs)
    assert duplicates == 0
    assert objects == found
    assert np.median(errors_m) < 0.06
    if reach_m > 4.0:
        assert joined == [10] * len(runs)


def test_without_maps_and_with_empty_ones():
    assert merge_all({}).objects == []
    merged = merge_all({"a": ([], NO_ANNOTATIONS), "b": ([], NO_ANNOTATIONS)})
    assert list(merged.alignments) == ["a"]
    assert "share 0 objects" in merged.refused["b"]


def test_a_base_gives_the_frame_though_other_maps_agree_more():
    random = np.random.default_rng(4)
    room, elsewhere = furnished(random, 14), furnished(random, 12)
    maps = {name: (mapped(room, somewhere(random), random, 0.04), NO_ANNOTATIONS) for name in "ab"}
    maps["base"] = (mapped(elsewhere), NO_ANNOTATIONS)
    merged = merge_all(maps, base="base")
    assert list(merged.alignments) == ["base"]
    assert merged.refused.keys() == {"a", "b"}
    assert sorted(merge_all(maps).alignments) == ["a", "b"]


def test_a_map_that_fits_onto_two_others_together_alone():
    """The first and the last share three objects, too few; the middle one shares six with each."""
    random = np.random.default_rng(1)
    room = furnished(random, 15)
    left, middle, right = room[:9], room[3:12], room[6:]
    maps = {name: (mapped(part), NO_ANNOTATIONS) for name, part in zip("abc", (left, middle, right), strict=True)}
    assert sorted(merge_all(maps).alignments) == ["a", "b", "c"]
    assert len(merge_all(maps).objects) == len(room)
    assert list(merge_all({"a": maps["a"], "c": maps["c"]}).alignments) == ["a"]
