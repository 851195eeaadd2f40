"""Maps made side by side are those that each would be alone."""

import numpy as np
import pytest

from edgemap.benchmarks.map_variants import remembering, replayed
from edgemap.runtime.inputs.drives import open_drive
from edgemap.runtime.inputs.open import DEMO
from edgemap.runtime.network.bundle import load_bundle
from edgemap.runtime.network.store import bundle_folder
from edgemap.runtime.step.config import Config
from edgemap.runtime.step.mapper import new_mapper
from edgemap.runtime.step.slam import SlamOptions


@pytest.fixture(scope="module")
def demo():
    return open_drive(f"drive:{DEMO}"), load_bundle(bundle_folder("edgemap-nano"))


def places(slam):
    return {item.id: np.round(item.position_m, 9).tolist() for item in slam.objects()}


def test_side_by_side_is_the_same_as_alone(demo):
    """Each has an attitude, a tracker and a map of its own; they share the pictures and the backbone's outputs."""
    drive, bundle = demo
    variants = {"wheels": SlamOptions(), "none": SlamOptions(wheels=False), "true": SlamOptions("truth")}
    together = replayed(drive, bundle, variants, 16)
    assert places(together["wheels"]) != places(together["none"]) != places(together["true"])
    for name, variant in variants.items():
        assert places(replayed(drive, bundle, {name: variant}, 16)[name]) == places(together[name])


@pytest.mark.parametrize("most", [None, 1])
def test_a_remembered_picture_has_the_outputs_of_the_network(demo, most):
    _, bundle = demo
    kept = remembering(bundle, most).backbone
    tensors = kept.zeros()
    first, again, plain = kept.run(tensors), kept.run(tensors), bundle.backbone.run(tensors)
    for name, values in plain.items():
        np.testing.assert_array_equal(first[name], values)
        assert again[name] is first[name]
    kept.run({name: values + 1.0 for name, values in tensors.items()})
    assert all((kept.run(tensors)[name] is values) == (most is None) for name, values in first.items())


@pytest.mark.parametrize(
    ("closes", "how"),
    [
        (True, {}),
        (False, {"odometry": "truth"}),
        (False, {"odometry": "poses.tum"}),
        (False, {"clustering": "paper"}),
        (False, {"loop_closure": False}),
    ],
)
def test_loops_close_only_where_poses_are_not_given(closes, how):
    assert new_mapper(Config(), **how).loop_closer.closes_loops == closes
