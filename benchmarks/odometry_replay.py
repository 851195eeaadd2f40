"""A camera's frames through an odometry alone, without detector and map, beside the truth."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.camera.attitude import Attitude
from edgemap.geometry.camera.imu import ImuSamples
from edgemap.geometry.camera.intrinsics import Intrinsics
from edgemap.geometry.se2 import SE2
from edgemap.runtime.attitude.protocol import AttitudeSource
from edgemap.runtime.bundle import Bundle
from edgemap.runtime.cameras.protocol import Camera
from edgemap.runtime.errors import OdometryError
from edgemap.runtime.frame import Frame
from edgemap.runtime.health import HealthMonitor
from edgemap.runtime.network import Tensors
from edgemap.runtime.odometry.protocol import Odometry
from edgemap.runtime.preprocess import Preprocessor


class Features(Tensors):
    """A frame's backbone outputs by name; the backbone runs when one is asked for, or not at all."""

    def __init__(self, compute: Callable[[], Tensors]) -> None:
        super().__init__()
        self._compute: Callable[[], Tensors] | None = compute

    def __bool__(self) -> bool:
        """There are some, computed or not: without any, the hybrid's network would sleep."""
        return True

    def __missing__(self, name: str) -> NDArray[np.float32]:
        if self._compute is None:
            raise KeyError(name)
        self.update(self._compute())
        self._compute = None
        return self[name]


class FeatureSource:
    """A bundle's backbone as the maker of each frame's `Features`. lens: of the camera."""

    def __init__(self, bundle: Bundle, lens: Intrinsics) -> None:
        fitted = bundle.for_pictures(lens.width, lens.height)
        self._backbone = fitted.backbone
        self._input_name = fitted.detector.input.name
        self._preprocess = Preprocessor(fitted.detector.input)

    def __call__(self, frame: Frame) -> Features:
        """What the odometry's step gets of this frame."""
        return Features(lambda: self._backbone.run({self._input_name: self._preprocess(frame.image)[0]}))


@dataclass(frozen=True, slots=True, eq=False)
class Followed:
    """N frames of a drive. indices: which of the camera's frames. true, estimated: N poses of the base in the frame of
    the first one. covariances: (N - 1, 3, 3) of the estimated motions. faults: motions that were guesses.
    attitudes: N, as the odometry was told. members: of each motion, as of `Motion.members`; an odometry that has none
    is its own."""

    indices: tuple[int, ...]
    stamps_s: NDArray[np.float64]
    true: tuple[SE2, ...]
    estimated: tuple[SE2, ...]
    covariances: NDArray[np.float64]
    faults: int
    attitudes: tuple[Attitude | None, ...] = ()
    members: tuple[Mapping[str, str], ...] = ()


def follow(
    camera: Camera,
    odometry: Odometry,
    features: Callable[[Frame], Tensors],
    *,
    first: int = 0,
    attitude: AttitudeSource | None = None,
    every: int = 1,
    frames: int | None = None,
    progress: Callable[[], object] = lambda: None,
) -> Followed:
    """Feed every `every`-th frame from `first` on, `frames` of them at most, and add up the motions.

    features: of a frame, as `FeatureSource` gives them. attitude: of each frame, for the odometry.
    progress: called after each frame that is fed. Raises
    OdometryError where the camera brings no true poses or fewer than two frames.
    """
    if camera.truth is None:
        raise OdometryError(f"{camera.name} brings no true poses of its own to compare with")
    attitudes: list[Attitude | None] = []
    indices: list[int] = []
    stamps_s: list[float] = []
    true: list[SE2] = []
    estimated: list[SE2] = []
    covariances: list[NDArray[np.float64]] = []
    members: list[Mapping[str, str]] = []
    faults, health, skipped, moved = 0, HealthMonitor(), [], None
    while (frames is None or len(indices) < frames) and (frame := camera.read()) is not None:
        skipped.append(frame.imu)
        if frame.index < first or (frame.index - first) % every:
            continue
        frame, skipped = replace(frame, imu=ImuSamples.joined(skipped)), []
        frame = replace(frame, moved=moved)
        frame = replace(frame, attitude=None if attitude is None else attitude.step(frame))
        attitudes.append(frame.attitude)
        picture = health.judge(frame)
        if picture.blind:
            step = odometry.step_blind(frame.stamp_s, picture.reason, frame.attitude)
        else:
            step = odometry.step(replace(frame, index=len(indices)), features(frame))
        step = step.checked(odometry.name)
        moved = step.moved()
        true.append(camera.truth.at(frame.stamp_s))
        if indices:
            estimated.append(estimated[-1] @ step.motion)
            covariances.append(step.covariance)
            guessed = bool(step.fault or step.blind)
            members.append(step.members or {odometry.name: "blind" if guessed else "used"})
            faults += guessed
        else:
            estimated.append(SE2())
        indices.append(frame.index)
        stamps_s.append(frame.stamp_s)
        progress()
    if len(indices) < 2:
        raise OdometryError(f"{camera.name}: {len(indices)} frames from frame {first} on, a motion needs two")
    start = true[0].inverse()
    return Followed(
        tuple(indices), np.array(stamps_s), tuple(start @ pose for pose in true), tuple(estimated),
        np.array(covariances), faults, tuple(attitudes), tuple(members),
    )  # fmt: skip
