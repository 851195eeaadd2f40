"""An IMU for a recorded drive that has none, made from its 6-DoF poses: SYNTHETIC, for experiments.

    python -m edgemap.simulation.carried_imu c2w:DIR -o NEW_DIR [--seed N] [--rest SECONDS]

NEW_DIR links to all that is in DIR and holds an `imu.csv` beside it; `c2w:NEW_DIR` is the drive with the IMU.
"""

import argparse
from pathlib import Path

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation, RotationSpline

from edgemap.geometry.camera.imu import ImuSamples
from edgemap.runtime.frames.errors import CameraError
from edgemap.runtime.inputs.drives import open_drive
from edgemap.runtime.inputs.drives.drive import Drive
from edgemap.runtime.inputs.drives.sensor_csv import write_imu_csv
from edgemap.simulation.render.mesh import Array
from edgemap.simulation.robot.imu import ImuErrors, measured
from edgemap.simulation.robot.router import smoothed

SMOOTH = 1.0  # frames; recorded places jitter by centimetres, which are no accelerations
START_S, STEP_S = 1.0, 0.1  # from rest to the first picture; between poses at rest


def carried_imu(
    drive: Drive, rng: np.random.Generator, rest_s: float = 0.0, errors: ImuErrors | None = None
) -> ImuSamples:
    """Samples of a camera that rests for so long, sets off, and passes through the drive's 6-DoF poses.

    Raises CameraError where the poses have fewer dimensions.
    """
    if drive.full_poses is None or drive.mount is None or len(drive.stamps_s) < 3:
        raise CameraError(f"{drive.folder}: an IMU is made from at least 3 poses of six dimensions and a mount")
    at_rest = np.arange(0.0, rest_s, STEP_S) if rest_s > 0.0 else np.zeros(0)
    knots_s = np.concatenate([drive.stamps_s[0] - START_S - rest_s + at_rest, drive.stamps_s])
    poses = np.concatenate([np.repeat(drive.full_poses[:1], len(at_rest), axis=0), drive.full_poses])
    turned = RotationSpline(knots_s, Rotation.from_matrix(poses[:, :3, :3] @ drive.mount.rotation_base_optical()))
    places = CubicSpline(knots_s, smoothed(poses[:, :3, 3], SMOOTH))
    errors = errors or ImuErrors()

    def lens(stamps_s: Array) -> tuple[Array, Array]:
        return turned(stamps_s).as_matrix(), places(stamps_s)

    period_s = 1.0 / errors.rate_hz
    return measured(np.arange(knots_s[0] + period_s, knots_s[-1] - period_s, period_s), lens, rng, errors)


def main() -> None:
    """Write the folder that the command line names."""
    parser = argparse.ArgumentParser(description="Give a drive of 6-DoF poses a synthetic IMU.")
    parser.add_argument("data", metavar="KIND:DIR")
    parser.add_argument("-o", "--out", type=Path, required=True, metavar="NEW_DIR")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--rest", type=float, default=0.0, metavar="SECONDS", help="At rest before the first picture.")
    given = parser.parse_args()
    drive = open_drive(given.data)
    samples = carried_imu(drive, np.random.default_rng(given.seed), given.rest)
    given.out.mkdir(parents=True)
    for path in drive.folder.resolve().iterdir():
        if path.name != "imu.csv":
            (given.out / path.name).symlink_to(path)
    write_imu_csv(given.out / "imu.csv", samples)


if __name__ == "__main__":
    main()
