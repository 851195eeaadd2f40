"""A camera's frames through the front end, without a map, beside the truth."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from itertools import accumulate
from operator import matmul

import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.camera.attitude import Attitude
from edgemap.geometry.camera.imu import ImuSamples
from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.errors import OdometryError
from edgemap.runtime.inputs.cameras.protocol import Camera
from edgemap.runtime.step.frame_observations import FrameObservations
from edgemap.runtime.step.pipeline import Pipeline


@dataclass(frozen=True, slots=True, eq=False)
class Followed:
    """N frames of a drive. indices: which of the camera's frames. true, estimated: N poses of the base in the frame of
    the first one. covariances: (N - 1, 3, 3) of the estimated motions. faults: motions that were guesses.
    attitudes: N, as given to the odometry. members: of each motion, as of `Motion.members`; an odometry that has none
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
    pipeline: Pipeline,
    *,
    first: int = 0,
    every: int = 1,
    frames: int | None = None,
    progress: Callable[[], object] = lambda: None,
) -> Followed:
    """Passes every `every`-th frame from `first` on, at most `frames`, through the front end, and integrates the
    motions. progress: called after each frame. Raises OdometryError where the camera brings no true poses or fewer than
    two frames.
    """
    if camera.truth is None:
        raise OdometryError(f"{camera.name} brings no true poses of its own to compare with")
    indices: list[int] = []
    true: list[SE2] = []
    observed: list[FrameObservations] = []
    skipped: list[ImuSamples] = []
    while (frames is None or len(indices) < frames) and (frame := camera.read()) is not None:
        skipped.append(frame.imu)
        if frame.index < first or (frame.index - first) % every:
            continue
        frame, skipped = replace(frame, imu=ImuSamples.joined(skipped), index=len(indices)), []
        observed.append(pipeline.step(frame))
        true.append(camera.truth.at(frame.stamp_s))
        indices.append(first + every * len(indices))
        progress()
    if len(indices) < 2:
        raise OdometryError(f"{camera.name}: {len(indices)} frames from frame {first} on, a motion needs two")
    start, motions = true[0].inverse(), [one.motion for one in observed[1:]]
    guessed = [motion.blind for motion in motions]
    name = pipeline.odometry.name
    return Followed(
        tuple(indices),
        np.array([one.stamp_s for one in observed]),
        tuple(start @ pose for pose in true),
        tuple(accumulate((motion.motion for motion in motions), matmul, initial=SE2())),
        np.array([motion.covariance for motion in motions]),
        sum(guessed),
        tuple(one.camera.attitude if one.camera else None for one in observed),
        tuple(m.members or {name: "blind" if b else "used"} for m, b in zip(motions, guessed, strict=True)),
    )
