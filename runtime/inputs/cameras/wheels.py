"""Wheel odometry in files: a CSV, or a file that a kind of camera reads, such as a recording."""

from pathlib import Path

from edgemap.runtime.frames.camera import Camera
from edgemap.runtime.frames.trajectory import TrackFile, Trajectory
from edgemap.runtime.inputs.cameras.kinds import file_kind
from edgemap.runtime.inputs.drives.sensor_csv import read_wheel_csv

PREFIX = "wheel:"


def wheel_file(spec: str | Path) -> TrackFile:
    """The wheels' poses in a file, read when they are needed."""
    return TrackFile(str(spec), read_wheels)


def read_wheels(spec: str) -> Trajectory:
    """The wheels' poses in `FILE.csv`, or in a file of a camera kind (`FILE.mcap[#/topic]`). Raises CameraError."""
    kind = file_kind(spec)
    return Trajectory(*read_wheel_csv(Path(spec))) if kind is None else kind.wheels(spec)


def replace_wheels(camera: Camera, odometry: str) -> str:
    """With the odometry `wheel:FILE` the camera gets the wheels of that file. Returns the odometry without the file."""
    if not odometry.startswith(PREFIX):
        return odometry
    camera.update_info(wheel=wheel_file(odometry.removeprefix(PREFIX)))
    return "wheel"
