"""Attitudes that were recorded with 6-DoF poses."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.camera.attitude import Attitude

Array = NDArray[np.float64]

SIGMA_RAD = math.radians(0.2)  # of a recorded pose in its own frame, picture and pose not quite in step


@dataclass(frozen=True, slots=True, eq=False)
class AttitudeTrack:
    """Roll and pitch of the camera in the angles of `Mount`, (N,) each, and how far the lens rose since the first
    pose, metres (N,), at increasing stamps (N,) in seconds."""

    stamps_s: Array
    roll_rad: Array
    pitch_rad: Array
    risen_m: Array

    @classmethod
    def of_up(cls, stamps_s: Array, up_optical: Array, heights_m: Array) -> "AttitudeTrack":
        """From the direction that points up in the optical frame, (N, 3), and heights of the lens, (N,)."""
        angles = [Attitude.of_up(up, np.zeros((2, 2)), "truth") for up in up_optical]
        roll, pitch = np.array([(a.roll_rad, a.pitch_rad) for a in angles]).T
        return cls(stamps_s, np.unwrap(roll), np.unwrap(pitch), heights_m - heights_m[0])

    def at(self, stamp_s: float, height_m: float) -> Attitude:
        """The attitude at a stamp, interpolated; held beyond both ends. height_m: the lens's at the first pose."""
        roll, pitch, risen = (
            float(np.interp(stamp_s, self.stamps_s, values)) for values in (self.roll_rad, self.pitch_rad, self.risen_m)
        )
        return Attitude(roll, pitch, np.eye(2) * SIGMA_RAD**2, height_m + risen, source="truth")
