"""Drives as training data: cached features of the frozen backbone, with the true motion."""

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from edgemap.evaluation.trajectory import motions
from edgemap.export.backbones import Backbone
from edgemap.export.errors import ExportError
from edgemap.geometry.se2 import SE2
from edgemap.runtime.inputs.cameras.pictures import drive_camera
from edgemap.runtime.inputs.drives import Drive, open_drive
from edgemap.runtime.network.engines import open_network
from edgemap.runtime.network.network import Compute
from edgemap.runtime.network.preprocess import Preprocessor

FORMAT = "edgemap.features/1"


@dataclass(frozen=True, slots=True, eq=False)
class FeatureDrive:
    """One drive, ready for training. features: (N, C, H, W) float16, on disk. poses: N of the base."""

    name: str
    features: NDArray[np.float16]
    poses: list[SE2]

    def __len__(self) -> int:
        return len(self.poses)

    @property
    def motions(self) -> NDArray[np.float32]:
        """True motions (N - 1, 3) from each frame to the next."""
        return np.array([motion.vector() for motion in motions(self.poses)], dtype=np.float32)


class FeatureStore:
    """Cached features in a folder, keyed by the backbone's bytes, its input rule and its feature's name."""

    def __init__(self, part: Backbone, folder: Path, threads: int = 2) -> None:
        detector = part.manifest.detector
        self.input, (feature,) = detector.input, detector.features
        self._name, self.shape = feature.name, feature.shape
        model = part.model.SerializeToString(deterministic=True)
        # A mirrored picture's raw YOLOv3 map is the mirrored map with negated x offsets of boxes; others: unknown.
        raw = [head for head in detector.heads if detector.decode == "yolov3" and head.name == self._name]
        values = self.shape[1] // max(1, *(len(head.anchors) for head in raw)) if raw else 0
        self.mirror = np.where(np.arange(self.shape[1]) % values, 1.0, -1.0).astype(np.float32) if raw else None
        about = f"{FORMAT} {hashlib.sha256(model).hexdigest()} {self.input} {self._name}"
        self.folder = folder / hashlib.sha256(about.encode()).hexdigest()[:16]
        self._network = open_network(model, Compute(threads))

    def load(self, specs: Sequence[str], first: int = 0, frames: int | None = None) -> list[FeatureDrive]:
        """All drives `KIND:DIR`; missing features are computed. Raises ExportError or CameraError."""
        bar = tqdm(specs, unit=" drives", disable=None if len(specs) > 1 else True)
        return [self.drive(spec, first, frames) for spec in bar]

    def drive(self, spec: str, first: int = 0, frames: int | None = None) -> FeatureDrive:
        """One drive from a frame on. Raises ExportError where it has no true poses."""
        drive = open_drive(spec)
        if drive.truth is None:
            raise ExportError(f"{spec}: training an odometry needs true poses")
        total = len(drive.stamps_s)
        count = min(total, total if frames is None else first + frames)
        if count - first < 2:
            raise ExportError(f"{spec}: {total} pictures, wanted are those from {first} to {count}")
        poses = [drive.truth.at(float(stamp)) for stamp in drive.stamps_s[first:count]]
        return FeatureDrive(spec, self._features(spec, drive, count)[first:], poses)

    def _features(self, spec: str, drive: Drive, count: int) -> NDArray[np.float16]:
        about = f"{spec} {drive.folder.resolve()} {len(drive.stamps_s)} {_content(drive)} {count}"
        path = self.folder / f"{hashlib.sha256(about.encode()).hexdigest()[:16]}.npy"
        if not path.is_file():
            self.folder.mkdir(parents=True, exist_ok=True)
            part, preprocess = path.with_suffix(".part"), Preprocessor(self.input)
            kept = np.lib.format.open_memmap(part, "w+", np.float16, (count, *self.shape[1:]))
            with drive_camera(drive, spec) as source:
                for index in range(count):
                    frame = source.read()
                    if frame is None:
                        raise ExportError(f"{spec}: ends after {index} pictures, {len(drive.stamps_s)} were announced")
                    kept[index] = self._network.run({self.input.name: preprocess(frame.image)[0]})[self._name][0]
            kept.flush()
            part.replace(path)
        return np.load(path, mmap_mode="r")


def _content(drive: Drive) -> str:
    """Checksum of the pictures: of the video, or of each file's size and time."""
    if drive.video is not None:
        with drive.video.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    found = [(path.name, stat.st_size, stat.st_mtime_ns) for path in drive.images for stat in [path.stat()]]
    return hashlib.sha256(repr(found).encode()).hexdigest()
