"""LoCoBot: `rgb/` and `depth/` pictures, 640x480, with the base's wheel odometry.

    rgb/000000.png …       colour, one per stamp (any picture format)
    depth/000000.png …     optional; 16-bit, millimetres, aligned with rgb/ and as many
    odometry.csv           stamp_s,x_m,y_m,yaw_rad: integrated wheel odometry, one row per picture
    camera.yaml            lens and mount
    poses.tum              optional; base poses from something better than wheels, one per picture

No public data in this form exists; the layout is edgemap's. Truth is `poses.tum` where it is there, else the wheel
odometry itself, which drifts.
"""

from pathlib import Path

from edgemap.runtime.frames.spatial_poses import planarise_base
from edgemap.runtime.inputs.drives.camera_yaml import read_setup
from edgemap.runtime.inputs.drives.drive import Drive
from edgemap.runtime.inputs.drives.pictures import list_pictures
from edgemap.runtime.inputs.drives.pose_files import check_count, depth_beside, read_tum_3d, trajectory
from edgemap.runtime.inputs.drives.sensor_csv import read_wheel_csv


def read_locobot(folder: Path) -> Drive:
    """Read a LoCoBot folder as described above. Raises CameraError."""
    images = list_pictures(folder / "rgb")
    depth = depth_beside(folder, len(images), folder / "rgb")
    setup = read_setup(folder, world_up="z")
    wheel_path = folder / "odometry.csv"
    stamps, poses = read_wheel_csv(wheel_path)
    check_count(wheel_path, len(stamps), len(images), folder / "rgb")
    truth = trajectory(wheel_path, stamps, poses)
    better = folder / "poses.tum"
    if better.is_file():
        _, matrices = read_tum_3d(better)
        check_count(better, len(matrices), len(images), folder / "rgb")
        truth = trajectory(better, stamps, planarise_base(matrices, setup.world_up))
    lens, mount, rate_hz = setup.intrinsics, setup.mount, setup.rate_hz
    return Drive(
        "locobot", folder, images, stamps, lens, mount, rate_hz, truth, wheel=wheel_path, depth=depth,
        depth_camera=setup.depth,
    )  # fmt: skip
