"""What run.json states before the first frame."""

from types import SimpleNamespace
from typing import Any

import pytest

from edgemap.cli.run_options import (
    AdvancedGroup,
    CameraGroup,
    MapGroup,
    OutputGroup,
    RobotGroup,
    RunOptions,
    WatchGroup,
)
from edgemap.cli.run_record import run_record
from edgemap.geometry.camera.floor import FloorCamera
from edgemap.geometry.camera.intrinsics import Intrinsics
from edgemap.geometry.camera.mount import Mount
from edgemap.runtime.frames.camera import CameraInfo
from edgemap.runtime.network.bundle import load_bundle
from edgemap.runtime.network.store import bundle_folder
from edgemap.runtime.step.config import Config

LENS = Intrinsics(640, 480, 587.0, 587.0, 319.5, 239.5)


@pytest.mark.parametrize(
    ("odometry", "height_m", "stated"),
    [("hybrid", 0.6, False), ("hybrid", 1.65, False), ("window", 1.65, False), ("flow", 1.65, True)],
)
def test_a_lens_outside_the_flow_heads_training_is_stated_where_the_head_is_used(odometry, height_m, stated):
    """At head height the window of keyframes takes its place, but for `--odometry flow`."""
    robot = RobotGroup(odometry=odometry)
    options = RunOptions(CameraGroup(), robot, MapGroup(), WatchGroup(), OutputGroup(), AdvancedGroup())
    source: Any = SimpleNamespace(info=CameraInfo("made"))
    bundle, floor = load_bundle(bundle_folder("edgemap-nano"), 1), FloorCamera(LENS, Mount(height_m, 0.2))
    record = run_record(options, source, bundle, floor, 0.3, frozenset({"chair"}), Config())
    assert ("height_m" in record["envelope"]) == stated
