"""The simulated camera: its lens and mount, and how its sensor is imperfect."""

from dataclasses import dataclass

from edgemap.geometry.camera.intrinsics import Intrinsics
from edgemap.geometry.camera.mount import Mount

_INTRINSICS = Intrinsics(640, 480, 587.0, 587.0, 319.5, 239.5)
_MOUNT = Mount.from_degrees(0.60, 11.5, forward_m=0.15)


@dataclass(frozen=True, slots=True)
class CameraSetup:
    """The camera and how it is mounted; the default is the demo's."""

    intrinsics: Intrinsics = _INTRINSICS
    mount: Mount = _MOUNT
    rate_hz: float = 10.0


@dataclass(frozen=True, slots=True)
class Effects:
    """Effects of a real camera; all zero leaves the rendered picture unchanged.

    exposure_s: shutter time in good light. readout_s: from the first row to the last. shake_rad: standard deviation of
    pitch and roll per picture while driving. shot, read: standard deviations of the noise, in parts of full scale at
    full scale and in the dark, at gain 1. lag_s: of the automatic exposure. jpeg_quality: 0..100; None for none.
    """

    exposure_s: float = 0.0
    readout_s: float = 0.0
    shake_rad: float = 0.0
    shot: float = 0.0
    read: float = 0.0
    lag_s: float = 0.6
    jpeg_quality: int | None = None
