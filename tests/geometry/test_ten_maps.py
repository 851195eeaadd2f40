"""Ten maps of one home and one of another home become one map (`python -m pytest -s` prints the figures)."""

from dataclasses import dataclass

import numpy as np
import pytest
from support.rooms import furnished, mapped, somewhere

from edgemap.geometry.objects.annotations import NO_ANNOTATIONS
from edgemap.geometry.objects.merge import merge_all

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
        distance_m, row = min(
            (float(np.hypot(*(place - thing[1:]))), row) for row, thing in enumerate(home) if thing[0] == item.label
        )
        if distance_m < NEAR_M:
            matched.append(row)
            errors_m.append(distance_m)
    return TenMaps(
        set(merged.alignments), len(merged.objects), len(set(matched)), len(matched) - len(set(matched)), errors_m
    )


@pytest.mark.parametrize("reach_m", [4.0, 5.0, 7.0])
def test_ten_maps_of_a_home_are_one_and_another_home_stays_out(reach_m):
    runs = [ten_maps(seed, reach_m) for seed in range(HOMES)]
    joined, errors_m = [len(run.joined) for run in runs], np.concatenate([run.errors_m for run in runs])
    objects, found, duplicates = (
        sum(getattr(run, what) for run in runs) for what in ("objects", "found", "duplicates")
    )
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
