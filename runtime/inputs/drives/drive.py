"""A recorded drive in memory: paths of its pictures, calibration and truth, independent of the layout on disk."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.camera.depth_camera import DepthCamera
from edgemap.geometry.camera.imu import ImuSamples
from edgemap.geometry.camera.intrinsics import Intrinsics
from edgemap.geometry.camera.mount import Mount, Platform
from edgemap.runtime.frames.trajectory import AttitudeTrack, Trajectory

# An object counts as visible in a picture from this visible share and this length of its box's longer side on.
SEEN_SHARE, SEEN_SIDE_PX = 0.30, 24.0


@dataclass(frozen=True, slots=True)
class LabelledBoxes:
    """True boxes of one picture: xyxy in px from the outer edge of the first one, (N, 4); class names, length N.

    visible: share of each box that is not hidden, 0..1, shape (N,); None where unknown.
    ids: object of `objects.json` for each box; empty where unknown. scores: of a network that predicted the boxes,
    (N,); None for true boxes. Low-score boxes have a visibility of 0.
    """

    boxes: NDArray[np.float64]
    labels: tuple[str, ...]
    visible: NDArray[np.float64] | None = None
    ids: tuple[str, ...] = ()
    scores: NDArray[np.float64] | None = None

    def visible_ids(self) -> set[str]:
        """Ids of the objects visible in this picture; an unknown visibility counts as complete."""
        return {identity for identity, counts in zip(self.ids, self.counted(), strict=False) if counts}

    def counted(self) -> NDArray[np.bool_]:
        """Which boxes count as visible, (N,)."""
        visible = np.ones(len(self.boxes)) if self.visible is None else self.visible
        sides_px = (self.boxes[:, 2:] - self.boxes[:, :2]).max(axis=1, initial=0.0)
        return (visible >= SEEN_SHARE) & (sides_px >= SEEN_SIDE_PX)

    def ignorable(self) -> NDArray[np.bool_]:
        """Which boxes are ignored when a detector is judged, (N,): too little visible; none if unknown."""
        return np.zeros(len(self.boxes), dtype=bool) if self.visible is None else ~self.counted()


@dataclass(frozen=True, slots=True)
class Drive:
    """One drive, read from any KIND of folder.

    images: in order of time; empty for a drive whose pictures are in `video`. stamps_s: seconds, one per picture; empty
    for a video at its own stamps.
    truth: poses of the base, relative to the first one. boxes: true boxes per picture, empty where unknown.
    objects: records of `objects.json`. wheel: the wheels' poses.
    attitudes: of the camera, where the recorded poses have six dimensions. imu: samples in the optical frame.
    depth: depth pictures, one per image, empty where there are none. depth_camera: theirs; None where they are
    registered to the pictures. full_poses: of the lens, (N, 4, 4), one per picture, base axes in a z-up frame, where
    the recorded poses have six dimensions. world_up: axis of the recorded poses that points up, e.g. `-y`.
    """

    kind: str
    folder: Path
    images: tuple[Path, ...]
    stamps_s: NDArray[np.float64]
    intrinsics: Intrinsics | None = None
    mount: Mount | None = None
    rate_hz: float | None = None
    truth: Trajectory | None = None
    boxes: tuple[LabelledBoxes, ...] = ()
    objects: tuple[dict[str, Any], ...] = ()
    wheel: Trajectory | None = None
    video: Path | None = None
    depth: tuple[Path, ...] = ()
    depth_camera: DepthCamera | None = None
    full_poses: NDArray[np.float64] | None = None
    attitudes: AttitudeTrack | None = None
    imu: ImuSamples | None = None
    world_up: str = "z"


def ridden(kind: str, mount: Mount | None) -> Mount | None:
    """The mount on what the drives of a kind were recorded with: those of KITTI with a car."""
    return mount if mount is None or kind != "kitti" else replace(mount, platform=Platform.CAR)
