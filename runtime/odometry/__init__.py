"""Where the robot's motion comes from: `open_odometry` makes one from its name on the command line."""

from dataclasses import dataclass, field
from pathlib import Path

from edgemap.geometry.camera.floor import FloorCamera
from edgemap.runtime.bundle import Bundle
from edgemap.runtime.cameras.protocol import Camera
from edgemap.runtime.drives.sensor_csv import read_wheel_csv
from edgemap.runtime.errors import OdometryError
from edgemap.runtime.odometry.coasting import CoastingRule
from edgemap.runtime.odometry.gyro import GyroOdometry
from edgemap.runtime.odometry.hybrid import CAMERA, GYRO, WHEELS, HybridOdometry, HybridRule, Member
from edgemap.runtime.odometry.learned import FlowRule, LearnedOdometry
from edgemap.runtime.odometry.planar import PlanarOdometry, PlanarRule
from edgemap.runtime.odometry.protocol import Motion, Odometry
from edgemap.runtime.odometry.recorded import WHEEL, DriftRate, RecordedOdometry
from edgemap.runtime.odometry.resting import RestingOdometry
from edgemap.runtime.odometry.scale_check import ScaleCheck, ScaleRule
from edgemap.runtime.recordings.sensors import is_recording, read_wheel
from edgemap.runtime.trajectory import Trajectory, read_tum

__all__ = ["Motion", "Odometry", "OdometryRules", "open_odometry", "wheel_trajectory"]


@dataclass(frozen=True, slots=True)
class OdometryRules:
    """What is tuned of the robot's own motion: planar landmarks, the flow head's keyframes, wheels, the hybrid of all,
    a guess while blind, and camera against wheels."""

    planar: PlanarRule = field(default_factory=PlanarRule)
    flow: FlowRule = field(default_factory=FlowRule)
    wheels: DriftRate = WHEEL
    hybrid: HybridRule = field(default_factory=HybridRule)
    coasting: CoastingRule = field(default_factory=CoastingRule)
    scale: ScaleRule = field(default_factory=ScaleRule)


def open_odometry(
    spec: str,
    bundle: Bundle,
    camera: Camera,
    floor: FloorCamera,
    allow_untrained: bool = False,
    wheels: bool = True,
    rules: OdometryRules | None = None,
) -> Odometry:
    """The odometry that a SPEC names: hybrid, flow, planar, gyro, paper, truth, wheel:FILE.csv|.mcap or FILE.tum.

    wheels: whether the hybrid listens to the source's wheels, where it brings any.
    Raises OdometryError for one that is unknown or not to be had here.
    """
    rules = rules or OdometryRules()
    if spec == "hybrid":
        members = _members(bundle, camera, floor, wheels, rules)
        scale = ScaleCheck(floor.mount.height_m, rules.scale)
        return RestingOdometry(HybridOdometry(members, rules.hybrid, rules.coasting, scale))
    if spec == "gyro":
        return GyroOdometry()
    if spec == "planar":
        return RestingOdometry(PlanarOdometry(floor, rules.planar, rules.coasting))
    if spec in ("flow", "paper"):
        return LearnedOdometry(bundle, spec, floor, allow_untrained, rules.coasting, rules.flow)
    if spec == "truth":
        if camera.truth is None:
            raise OdometryError(f"odometry truth: {camera.name} brings no poses of its own")
        return RecordedOdometry(camera.truth, "truth", edge_s=POSES_EDGE_S)
    if spec.startswith("wheel:"):
        return RecordedOdometry(wheel_trajectory(spec.removeprefix("wheel:")), spec, rules.wheels)
    if spec.endswith(".tum"):
        return RecordedOdometry(read_tum(Path(spec)), spec, edge_s=POSES_EDGE_S)
    raise OdometryError(
        f"odometry {spec!r} is not hybrid, flow, planar, gyro, paper, truth, wheel:FILE.csv|.mcap or FILE.tum"
    )


def wheel_trajectory(path: str | Path) -> Trajectory:
    """The wheels' poses in a CSV or a recording. Raises CameraError."""
    return read_wheel(str(path)) if is_recording(str(path)) else Trajectory(*read_wheel_csv(Path(path)))


POSES_EDGE_S = 0.15  # poses that are taken as they are may end a frame early


def _members(bundle: Bundle, camera: Camera, floor: FloorCamera, wheels: bool, rules: OdometryRules) -> list[Member]:
    """Corners on the floor, the bundle's flow head where one is trained, wheels and gyro where there are any."""
    rule = rules.hybrid
    head, flow = bundle.manifest.odometry.get("flow"), None
    if head is not None and head.trained:
        flow = LearnedOdometry(bundle, "flow", floor, coasting=rules.coasting, rule=rules.flow)
    carried = flow is not None and flow.outside_envelope
    scale = rule.planar_covariance_scale * (rule.outside_planar_covariance_scale if carried else 1.0)
    members = [Member(PlanarOdometry(floor, rules.planar, rules.coasting), CAMERA, scale)]
    if flow is not None:
        scale = rule.flow_covariance_scale * (rule.outside_flow_covariance_scale if carried else 1.0)
        limits = rule.flow_reach_rad, rule.flow_alone_s, rule.flow_movers_scale
        members.append(Member(flow, CAMERA, scale, False, *limits))
    if wheels and camera.wheel is not None:
        given = camera.wheel
        track = wheel_trajectory(given) if isinstance(given, Path) else given
        recorded = RecordedOdometry(track, f"wheel:{given}", rules.wheels)
        members.append(Member(recorded, WHEELS, rule.wheels_covariance_scale))
    members.append(Member(GyroOdometry(), GYRO, rule.gyro_covariance_scale, optional=True))
    return members
