"""Drives as training data: cached features of the frozen backbone, with the true motion."""

import copy
import hashlib
import json
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from itertools import pairwise
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
import onnxruntime as ort
from numpy.typing import NDArray
from tqdm import tqdm

from edgemap.export.backbones import Backbone
from edgemap.export.errors import ExportError
from edgemap.export.odometry.flow import GRID_STRIDE
from edgemap.export.odometry.views import AugmentedView
from edgemap.geometry.camera.floor import FloorCamera
from edgemap.geometry.camera.mount import Mount
from edgemap.geometry.odometry.flow_cells import flow_cells
from edgemap.geometry.se2 import SE2
from edgemap.runtime.inputs.cameras.pictures import drive_camera
from edgemap.runtime.inputs.drives import Drive, open_drive
from edgemap.runtime.network.engines import PROVIDERS, session_options
from edgemap.runtime.network.network import Compute
from edgemap.runtime.network.preprocess import Preprocessor, cell_grid

FORMAT = "edgemap.features/1"
PLAIN = AugmentedView()  # the unchanged pictures
FEW_DRIVES, USUAL_VIEWS = 3, 8  # a flow head overfits so few drives: additional views of each


@dataclass(frozen=True, slots=True, eq=False)
class FeatureDrive:
    """One drive, ready for training. features: (N, C, H, W) float16, on disk. stamps_s: (N,). poses: (N, 3) of the
    base. cells, mount: as of `flow_cells`. angles: (N, 3), roll and pitch of the camera in rad, as in `Mount`, and the
    height of the lens in metres, where the base is not level. rotated: (3, 3), rotation of the camera from its mount
    (`AugmentedView`)."""

    name: str
    features: NDArray[np.float16]
    stamps_s: NDArray[np.float64]
    poses: NDArray[np.float64]
    cells: NDArray[np.float32]
    mount: NDArray[np.float32]
    angles: NDArray[np.float64] | None = None
    rotated: NDArray[np.float64] = field(default_factory=lambda: np.eye(3))

    def __len__(self) -> int:
        return len(self.stamps_s)

    @property
    def frame_s(self) -> float:
        """Time between two pictures, seconds."""
        return float(np.median(np.diff(self.stamps_s)))

    def mount_at(self, roll_rad: float, pitch_rad: float, height_m: float) -> NDArray[np.float32]:
        """The mount of a frame, (12,), in the form of `flow_cells`."""
        tilted = Mount(height_m, pitch_rad, roll_rad, float(self.mount[0, 9]), float(self.mount[0, 10]))
        rotation = tilted.rotation_base_optical() @ self.rotated
        return np.concatenate([rotation.ravel(), tilted.position_base_m()]).astype(np.float32)

    def motions(self, indices: NDArray[np.intp]) -> NDArray[np.float32]:
        """True motions (len - 1, 3) from each of these frames to the next."""
        poses = [SE2(*self.poses[index]) for index in indices]
        return np.array([(a.inverse() @ b).vector() for a, b in pairwise(poses)], dtype=np.float32).reshape(-1, 3)


class FeatureStore:
    """Cached features in a folder, keyed by the backbone's bytes, its input rule and the feature's name. An interrupted
    drive is continued.
    """

    def __init__(self, part: Backbone, feature: str, folder: Path, threads: int = 2) -> None:
        self.input = part.detector.input
        self._name = part.features[feature]
        self._model = part.model.SerializeToString(deterministic=True)
        spec = next(item for item in part.detector.features if item.name == self._name)
        self.shape, self.stride = tuple(spec.shape), spec.stride
        about = f"{FORMAT} {hashlib.sha256(self._model).hexdigest()} {self.input} {self._name}"
        self.folder = folder / hashlib.sha256(about.encode()).hexdigest()[:16]
        self._threads = threads
        self._session: ort.InferenceSession | None = None

    def load(
        self, specs: Sequence[str], first: int = 0, frames: int | None = None, workers: int = 1, views: int = 0
    ) -> list[FeatureDrive]:
        """All drives `KIND:DIR`; missing features are computed. Raises ExportError or CameraError.

        workers: processes, each of which computes a drive on one thread. views: additional views of each drive.
        """
        seen = [PLAIN, *(AugmentedView.drawn(1 + index) for index in range(views))]
        if workers > 1:
            store = copy.copy(self)
            store._session, store._threads = None, 1
            with ProcessPoolExecutor(workers, get_context("spawn")) as pool:
                jobs = [pool.submit(_compute, store, spec, first, frames, view) for spec in specs for view in seen]
                for job in tqdm(jobs, unit=" drives", disable=None):
                    job.result()
        bar = tqdm(specs, unit=" drives", disable=None if len(specs) > 1 else True)
        return [self.drive(spec, first, frames, view) for spec in bar for view in seen]

    def drive(self, spec: str, first: int = 0, frames: int | None = None, view: AugmentedView = PLAIN) -> FeatureDrive:
        """One drive from a frame on. Raises ExportError where it has no true poses or no mount."""
        drive = open_drive(spec)
        if drive.truth is None or drive.mount is None or drive.intrinsics is None:
            raise ExportError(f"{spec}: training an odometry needs true poses, the lens and the mount")
        total = len(drive.stamps_s)
        count = min(total, total if frames is None else first + frames)
        if count - first < 2:
            raise ExportError(f"{spec}: {total} pictures, wanted are those from {first} to {count}")
        stamps = np.asarray(drive.stamps_s[first:count], dtype=np.float64)
        poses = np.array([drive.truth.at(float(stamp)).vector() for stamp in stamps])
        camera = FloorCamera(drive.intrinsics, drive.mount)
        camera = camera if view == PLAIN else view.camera(camera)
        grid = cell_grid(self.input, drive.intrinsics.width, drive.intrinsics.height, GRID_STRIDE)
        cells, mount = flow_cells(camera, grid, view.rotation())
        side = np.where(view.mirrored, -1.0, 1.0)
        if view != PLAIN:
            cells *= view.shows(grid, drive.intrinsics)
        angles = None
        if drive.attitudes is not None:
            attitudes = [drive.attitudes.at(float(stamp), drive.mount.height_m) for stamp in stamps]
            angles = np.array([(side * one.roll_rad, one.pitch_rad, one.height_m) for one in attitudes])
        features = self._features(spec, drive, count, view)[first:]
        return FeatureDrive(spec, features, stamps, poses * [1.0, side, side], cells, mount, angles, view.rotation())

    def _features(self, spec: str, drive: Drive, count: int, view: AugmentedView) -> NDArray[np.float16]:
        about = f"{spec} {drive.folder.resolve()} {len(drive.stamps_s)} {_content(drive)}"
        about += "" if view == PLAIN else repr(view)
        key = hashlib.sha256(about.encode()).hexdigest()[:16]
        path, note = self.folder / f"{key}.npy", self.folder / f"{key}.json"
        self.folder.mkdir(parents=True, exist_ok=True)
        total = len(drive.stamps_s)
        saved: dict[str, Any] = json.loads(note.read_text()) if note.is_file() and path.is_file() else {}
        done = int(saved.get("frames", 0))
        if done < count:
            shape = (total, *self.shape[1:])
            kept = np.lib.format.open_memmap(path, "r+" if done else "w+", np.float16, None if done else shape)
            preprocess = Preprocessor(self.input)
            with drive_camera(drive, spec) as source:
                for index in range(count):
                    frame = source.read()
                    if frame is None:
                        raise ExportError(f"{spec}: ends after {index} pictures, {total} were announced")
                    if index >= done:
                        seen = frame.image
                        if view != PLAIN and drive.intrinsics is not None:
                            seen = view.picture(seen, drive.intrinsics, self.input.pad)
                        tensor, _ = preprocess(seen)
                        kept[index] = self._run(tensor)
            kept.flush()
            note.write_text(json.dumps({"data": spec, "frames": count, "feature": self._name}))
        return np.load(path, mmap_mode="r")[:count]

    def _run(self, tensor: NDArray[np.float32]) -> NDArray[np.float32]:
        if self._session is None:
            options = session_options(Compute(self._threads))
            self._session = ort.InferenceSession(self._model, options, providers=PROVIDERS)
        options = ort.RunOptions()
        options.only_execute_path_to_fetches = True  # the heads behind the features are not needed
        return np.asarray(self._session.run([self._name], {self.input.name: tensor}, options)[0])[0]


def usual_views(specs: Sequence[str]) -> int:
    """Default number of additional views of each of these drives."""
    if len(specs) > FEW_DRIVES:
        return 0
    lenses = [open_drive(spec).intrinsics for spec in specs]
    return 0 if any(lens and lens.distortion.model != "none" for lens in lenses) else USUAL_VIEWS


def _compute(store: FeatureStore, spec: str, first: int, frames: int | None, view: AugmentedView) -> None:
    """In a process of its own, which uses one session for all its drives."""
    shared = _STORES.setdefault(str(store.folder), store)
    shared.drive(spec, first, frames, view)


_STORES: dict[str, FeatureStore] = {}


def _content(drive: Drive) -> str:
    """Checksum of the pictures: of the video, or of each file's size and time."""
    if drive.video is not None:
        with drive.video.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    found = [(path.name, stat.st_size, stat.st_mtime_ns) for path in drive.images for stat in [path.stat()]]
    return hashlib.sha256(repr(found).encode()).hexdigest()
