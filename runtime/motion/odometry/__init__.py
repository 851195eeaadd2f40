"""Odometries; `open_odometry` makes one from its name on the command line."""

import math
from dataclasses import dataclass, field
from pathlib import Path

from edgemap.geometry.camera.floor import FloorCamera
from edgemap.geometry.camera.mount_tilt import MountTiltRule
from edgemap.runtime.frames.camera import Camera
from edgemap.runtime.frames.errors import OdometryError
from edgemap.runtime.frames.faults import FaultKind
from edgemap.runtime.motion.given_poses import GivenPoses, read_given
from edgemap.runtime.motion.health import HealthRule
from edgemap.runtime.motion.judge import JudgeRule, MotionJudge
from edgemap.runtime.motion.odometry.coasting import CoastingRule
from edgemap.runtime.motion.odometry.gyro import GyroOdometry
from edgemap.runtime.motion.odometry.hybrid import CAMERA, GYRO, WHEELS, HybridOdometry, HybridRule
from edgemap.runtime.motion.odometry.judged import JudgedOdometry
from edgemap.runtime.motion.odometry.paper import PaperOdometry
from edgemap.runtime.motion.odometry.protocol import Motion, Odometry
from edgemap.runtime.motion.odometry.recorded import WHEEL, DriftRate, RecordedOdometry
from edgemap.runtime.motion.odometry.window import PicturesRule, WindowOdometry
from edgemap.runtime.motion.odometry_names import HYBRID, is_pose_file, is_tf
from edgemap.runtime.network.bundle import Bundle

__all__ = ["Motion", "Odometry", "OdometryRules", "open_odometry"]

# Height of the lens of the tallest small robot: a higher one counts as carried at first, but on wheels or on a road.
HEAD_M = 1.36


@dataclass(frozen=True, slots=True)
class OdometryRules:
    """Tuned parameters of the odometries: corners in a window of keyframes (`pictures`), wheels, the hybrid of all, and
    the guess while blind.
    """

    pictures: PicturesRule = field(default_factory=PicturesRule)
    wheels: DriftRate = WHEEL
    hybrid: HybridRule = field(default_factory=HybridRule)
    coasting: CoastingRule = field(default_factory=CoastingRule)
    judge: JudgeRule = field(default_factory=JudgeRule)  # of poses and wheels that carry the map


def open_odometry(
    spec: str,
    bundle: Bundle,
    camera: Camera,
    floor: FloorCamera,
    wheels: bool = True,
    rules: OdometryRules | None = None,
    health: HealthRule | None = None,
    tilt: MountTiltRule | None = None,
    pose_frame: str | None = None,
) -> Odometry:
    """The odometry that a name stands for: hybrid, paper, truth, wheel, FILE.tum or tf.

    wheels: whether the hybrid uses the source's wheels, where it has any. health: rule of its pictures. tilt: rule of
    the camera's tilt about its mount. pose_frame: as of `read_given`. Raises OdometryError for one that is unknown or
    not available here.
    """
    rules, mount = rules or OdometryRules(), floor.mount
    judge, excluded = MotionJudge(rules.judge), FaultKind.POSES_EXCLUDED
    coasting = rules.coasting.of_unit(mount.platform.unit_m)

    def hybrid(wheels: bool) -> HybridOdometry:
        return HybridOdometry(hybrid_sources(camera, floor, wheels, rules, tilt), rules.hybrid, coasting, health)

    if spec == HYBRID:
        return hybrid(wheels)
    if spec == "paper":
        return PaperOdometry(bundle, coasting)
    if spec == "truth":
        if camera.info.truth is None:
            raise OdometryError(f"odometry truth: {camera.info.name} has no recorded poses")
        return RecordedOdometry(camera.info.truth, "truth")
    if spec == "wheel":
        if camera.info.wheel is None:
            raise OdometryError(f"odometry wheel: {camera.info.name} brings no wheel odometry")
        wheel = GivenPoses(camera.info.wheel, None, mount.height_m)
        return JudgedOdometry(WHEELS, lambda _: wheel, hybrid(False), judge, FaultKind.WHEELS_EXCLUDED, rules.wheels)
    if is_pose_file(spec):
        file = read_given(Path(spec), mount, pose_frame)
        count, rate_hz = camera.info.frame_count, camera.info.rate_hz
        span_s = (count - 1) / rate_hz if count and rate_hz else math.inf

        def given(from_s: float) -> GivenPoses:
            return file.by_clock(spec, from_s, from_s + span_s)

        return JudgedOdometry(spec, given, hybrid(False), judge, excluded)
    if is_tf(spec):
        if camera.info.tf is None:
            raise OdometryError(
                f"odometry {spec}: {camera.info.name} has no tf; a recording with /tf or ros2:/TOPIC has"
            )
        poses = camera.info.tf(spec.partition(":")[2], mount)
        return JudgedOdometry(spec, lambda _: poses, hybrid(False), judge, excluded, start=poses.start)
    raise OdometryError(f"odometry {spec!r} is not hybrid, paper, truth, wheel, FILE.tum or tf")


def hybrid_sources(
    camera: Camera, floor: FloorCamera, wheels: bool, rules: OdometryRules, tilt: MountTiltRule | None = None
) -> dict[str, Odometry]:
    """The hybrid's sources: corners in the pictures, wheels where the camera has them, and the gyro."""
    mount = floor.mount
    carried = mount.height_m > HEAD_M and camera.info.wheel is None and mount.platform.in_room
    pictures = WindowOdometry(floor, rules.pictures, rules.coasting, tilt, carried)
    sources: dict[str, Odometry] = {CAMERA: pictures}
    if wheels and camera.info.wheel is not None:
        sources[WHEELS] = RecordedOdometry(camera.info.wheel, WHEELS, rules.wheels)
    return sources | {GYRO: GyroOdometry()}
