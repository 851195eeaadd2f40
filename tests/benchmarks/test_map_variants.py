"""Maps made side by side are those that each would be alone."""

from dataclasses import replace

import numpy as np
import pytest

from edgemap.benchmarks.map_variants import Replay, Variant, map_drive, observed_by
from edgemap.geometry.camera.imu import ImuSamples
from edgemap.runtime.inputs.drives import open_drive
from edgemap.runtime.inputs.open import DEMO
from edgemap.runtime.network.bundle import load_bundle
from edgemap.runtime.network.store import bundle_folder
from edgemap.runtime.step.config import Config
from edgemap.runtime.step.loop_closing import LoopCloser


@pytest.fixture(scope="module")
def demo():
    return open_drive(f"drive:{DEMO}"), load_bundle(bundle_folder("edgemap-nano"))


def places(objects):
    return {item.id: np.round(item.position_m, 9).tolist() for item in objects}


def test_side_by_side_is_the_same_as_alone(demo):
    drive, bundle = demo
    variants = {"wheels": Variant("hybrid"), "none": Variant("hybrid", wheels=False), "true": Variant("truth")}
    together = map_drive(Replay(drive, bundle, 28), variants)
    assert places(together["wheels"]) != places(together["none"]) != places(together["true"])
    for name, variant in variants.items():
        assert places(map_drive(Replay(drive, bundle, 28), {name: variant})[name]) == places(together[name])


def test_true_poses_beside_it_tell_the_attitude_nothing(demo):
    """What the odometry measured corrects the attitude of an IMU: its own odometry, not the true poses beside it."""
    drive, bundle = demo
    assert drive.mount is not None
    count = 15
    stamps = np.arange(drive.stamps_s[0], drive.stamps_s[count], 0.01)
    up = drive.mount.rotation_base_optical().T @ [0.0, 0.0, 9.81]
    drive = replace(drive, imu=ImuSamples(stamps, np.zeros((len(stamps), 3)), np.tile(up, (len(stamps), 1))))
    told = []
    for variants in ({"own": Variant()}, {"true": Variant("truth"), "own": Variant()}):
        cameras = [seen["own"].camera for seen in observed_by(Replay(drive, bundle, count), variants)]
        told.append([camera.mount.pitch_rad for camera in cameras if camera])
        assert len(told[-1]) == len(cameras)
    assert told[0] == told[1]


def test_loops_close_only_where_poses_are_not_given():
    def closes(**variant):
        return isinstance(Variant(**variant).mapper(Config()).loop_closer, LoopCloser)

    assert closes(odometry="hybrid")
    assert not closes(odometry="truth")
    assert not closes(odometry="poses.tum")
    assert not closes(clustering="paper")
    assert not closes(loop_closure=False)
