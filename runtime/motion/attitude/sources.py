"""Attitudes that need no measurement: recorded ones, and the mount's."""

from collections.abc import Callable, Sequence
from dataclasses import replace

from edgemap.geometry.camera.attitude import Attitude, TrackedRotation
from edgemap.geometry.camera.mount import Mount
from edgemap.geometry.camera.mount_tilt import MountTiltRule
from edgemap.runtime.frames.faults import Fault
from edgemap.runtime.frames.frame import Frame
from edgemap.runtime.frames.trajectory import AttitudeTrack
from edgemap.runtime.motion.attitude.protocol import AttitudeSource, Moved

NODDING_RAD = MountTiltRule().nod / 2.0  # of a robot on wheels that brakes and rolls over hard floors


class MountAttitude:
    """The mount's angles in every frame, with the covariance of a robot that nods."""

    name = "mount"
    faults = ()

    def __init__(self, mount: Mount, sigma_rad: float = NODDING_RAD) -> None:
        self._sigma_rad = sigma_rad
        self.correct_mount(mount)

    def predict(self, frame: Frame, moved: Moved | None = None) -> Attitude:  # noqa: ARG002
        """The mount's attitude, the same in every frame."""
        return self._attitude

    def update(self, rotation: TrackedRotation | None) -> Attitude:  # noqa: ARG002
        """The mount's attitude, whatever was tracked."""
        return self._attitude

    def correct_mount(self, mount: Mount) -> None:
        """Sets the mount's angles from now on."""
        self._attitude = Attitude.of_mount(mount, self._sigma_rad)

    def reset(self, reason: str) -> None:
        """Does nothing: there is no state."""


class GivenAttitude:
    """The attitude by poses of others, where they have one; else another source's, which they leave its rotation.
    given: by stamp, None where it is not known."""

    def __init__(self, given: Callable[[float], Attitude | None], other: AttitudeSource) -> None:
        self.name, self._given, self._other = "poses", given, other
        self._attitude: Attitude | None = None  # of the last frame

    @property
    def faults(self) -> Sequence[Fault]:
        """Those of the other source."""
        return self._other.faults

    def predict(self, frame: Frame, moved: Moved | None = None) -> Attitude:
        """Read off the poses at the frame's stamp."""
        other, given = self._other.predict(frame, moved), self._given(frame.stamp_s)
        self._attitude = given and replace(
            other, roll_rad=given.roll_rad, pitch_rad=given.pitch_rad, covariance_rad2=given.covariance_rad2,
            height_m=given.height_m, source=self.name, predicted=False,
        )  # fmt: skip
        return self._attitude or other

    def update(self, rotation: TrackedRotation | None) -> Attitude:
        """The same attitude; the other source's where it is that."""
        other = self._other.update(rotation)
        return self._attitude or other

    def correct_mount(self, mount: Mount) -> None:
        """Passes the mount on: recorded poses take precedence."""
        self._other.correct_mount(mount)

    def reset(self, reason: str) -> None:
        """Resets the other source."""
        self._other.reset(reason)


class RecordedAttitude:
    """The attitude of recorded 6-DoF poses."""

    name = "truth"
    faults = ()

    def __init__(self, track: AttitudeTrack, mount: Mount) -> None:
        self._track, self._height_m, self._seen_s = track, mount.height_m, 0.0

    def predict(self, frame: Frame, moved: Moved | None = None) -> Attitude:  # noqa: ARG002
        """Read off the track at the frame's stamp."""
        self._seen_s = frame.stamp_s
        return self._track.at(frame.stamp_s, self._height_m)

    def update(self, rotation: TrackedRotation | None) -> Attitude:  # noqa: ARG002
        """Returns the same attitude: there is no prediction to correct."""
        return self._track.at(self._seen_s, self._height_m)

    def correct_mount(self, mount: Mount) -> None:
        """Ignored: recorded poses take precedence."""

    def reset(self, reason: str) -> None:
        """Does nothing: there is no state."""
