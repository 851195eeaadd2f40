"""Inertial samples: angular rate and specific force in the camera's optical frame."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.arrays import Array
from edgemap.geometry.errors import GeometryError


@dataclass(frozen=True, slots=True, eq=False)
class ImuSamples:
    """N samples in order of time. stamps_s (N,): the clock of the frames. gyro_rad_s (N, 3): angular rate.
    accel_m_s2 (N, 3): specific force (upwards at rest). Optical axes: x right, y down, z forward.

    Raises GeometryError for other shapes.
    """

    stamps_s: Array
    gyro_rad_s: Array
    accel_m_s2: Array

    def __post_init__(self) -> None:
        count = len(self.stamps_s)
        for name, shape in (("stamps_s", (count,)), ("gyro_rad_s", (count, 3)), ("accel_m_s2", (count, 3))):
            if getattr(self, name).shape != shape:
                raise GeometryError(f"IMU samples: {name} has shape {getattr(self, name).shape}, expected {shape}")

    @classmethod
    def none(cls) -> "ImuSamples":
        """No sample."""
        return cls(np.zeros(0), np.zeros((0, 3)), np.zeros((0, 3)))

    @classmethod
    def joined(cls, parts: "list[ImuSamples]") -> "ImuSamples":
        """All samples of the parts, in their order."""
        rows = ((part.stamps_s, part.gyro_rad_s, part.accel_m_s2) for part in (cls.none(), *parts))
        return cls(*map(np.concatenate, zip(*rows, strict=True)))

    def __len__(self) -> int:
        return len(self.stamps_s)

    def between(self, after_s: float, until_s: float) -> "ImuSamples":
        """The samples in (after_s, until_s]."""
        return self.rows(slice(*np.searchsorted(self.stamps_s, [after_s, until_s], side="right")))

    def rows(self, rows: slice | NDArray[np.bool_]) -> "ImuSamples":
        """Some of the samples."""
        return ImuSamples(self.stamps_s[rows], self.gyro_rad_s[rows], self.accel_m_s2[rows])

    def rotated(self, rotation: Array) -> "ImuSamples":
        """The samples in another frame: `rotation` (3, 3) takes directions of this frame into it."""
        return ImuSamples(self.stamps_s, self.gyro_rad_s @ rotation.T, self.accel_m_s2 @ rotation.T)
