"""Where the robot's motion comes from: `open_odometry` makes one from its name on the command line."""

from __future__ import annotations

from pathlib import Path

from edgemap.geometry.camera.floor import FloorCamera
from edgemap.runtime.bundle import Bundle
from edgemap.runtime.cameras.protocol import Camera
from edgemap.runtime.drives.wheel_csv import read_wheel_csv
from edgemap.runtime.errors import OdometryError
from edgemap.runtime.odometry.gyro import GyroOdometry
from edgemap.runtime.odometry.hybrid import GYRO, HybridOdometry, Member
from edgemap.runtime.odometry.learned import LearnedOdometry
from edgemap.runtime.odometry.planar import PlanarOdometry
from edgemap.runtime.odometry.protocol import Motion, Odometry
from edgemap.runtime.odometry.recorded import WHEEL, DriftRate, RecordedOdometry
from edgemap.runtime.odometry.resting import RestingOdometry
from edgemap.runtime.recordings.wheel import is_recording, read_wheel
from edgemap.runtime.trajectory import Trajectory, read_tum

__all__ = ["Motion", "Odometry", "open_odometry"]


def open_odometry(
    spec: str,
    bundle: Bundle,
    camera: Camera,
    floor: FloorCamera,
    allow_untrained: bool = False,
    wheels: bool = True,
    drift: DriftRate = WHEEL,
) -> Odometry:
    """The odometry that a SPEC names: hybrid, flow, planar, gyro, paper, truth, wheel:FILE.csv|.mcap or FILE.tum.

    wheels: whether the hybrid listens to the source's wheels, where it brings any. drift: of wheel odometry.
    Raises OdometryError for one that is unknown or not to be had here.
    """
    if spec == "hybrid":
        return RestingOdometry(HybridOdometry(_members(bundle, camera, floor, wheels, drift)))
    if spec == "gyro":
        return GyroOdometry()
    if spec == "planar":
        return RestingOdometry(PlanarOdometry(floor))
    if spec in ("flow", "paper"):
        return LearnedOdometry(bundle, spec, floor, allow_untrained)
    if spec == "truth":
        if camera.truth is None:
            raise OdometryError(f"odometry truth: {camera.name} brings no poses of its own")
        return RecordedOdometry(camera.truth, "truth", edge_s=POSES_EDGE_S)
    if spec.startswith("wheel:") and is_recording(spec):
        return RecordedOdometry(read_wheel(spec.removeprefix("wheel:")), spec, drift)
    if spec.startswith("wheel:"):
        return RecordedOdometry(Trajectory(*read_wheel_csv(Path(spec.removeprefix("wheel:")))), spec, drift)
    if spec.endswith(".tum"):
        return RecordedOdometry(read_tum(Path(spec)), spec, edge_s=POSES_EDGE_S)
    raise OdometryError(
        f"odometry {spec!r} is not hybrid, flow, planar, gyro, paper, truth, wheel:FILE.csv|.mcap or FILE.tum"
    )


POSES_EDGE_S = 0.15  # poses that are taken as they are may end a frame early

# Factors on the covariances of the hybrid's members, so that errors and covariance agree. With 2 for planar the camera
# alone drifts 4.4 % over 5 m on homes 9101-9104; with 4, as before its own covariance grew honest, 5.6 %.
DOUBTS = {"flow": 1.0, "planar": 2.0, "wheels": 1.0, "gyro": 1.0}

# A factor on the head's covariance for a camera outside its training envelope: with it a head camera 1.73 m up drifts
# 8.1 instead of 12.2 % over 5 m, with a gyro, and mean NEES falls from 109 to 9.
OUTSIDE_DOUBT = 25.0
OUTSIDE_PLANAR_DOUBT = 2.0  # such a camera is carried, and nods: on hololens mean NEES is 46 without it, 25 with it


def _members(bundle: Bundle, camera: Camera, floor: FloorCamera, wheels: bool, drift: DriftRate) -> list[Member]:
    """Corners on the floor, the bundle's flow head where one is trained, wheels and gyro where there are any."""
    head, flow = bundle.manifest.odometry.get("flow"), None
    if head is not None and head.trained:
        flow = LearnedOdometry(bundle, "flow", floor)
    carried = flow is not None and flow.outside_envelope
    doubt = DOUBTS["planar"] * (OUTSIDE_PLANAR_DOUBT if carried else 1.0)
    members = [Member(PlanarOdometry(floor), "camera", doubt)]
    if flow is not None:
        members.append(Member(flow, "camera", DOUBTS["flow"] * (OUTSIDE_DOUBT if carried else 1.0)))
    if wheels and camera.wheel is not None:
        recorded = open_odometry(f"wheel:{camera.wheel}", bundle, camera, floor, drift=drift)
        members.append(Member(recorded, "wheels", DOUBTS["wheels"]))
    members.append(Member(GyroOdometry(), GYRO, DOUBTS["gyro"], optional=True))
    return members
