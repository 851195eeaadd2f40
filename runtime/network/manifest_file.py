"""Reads, checks and writes a bundle's `bundle.json`, and checks the sums of its files."""

import hashlib
import math
from pathlib import Path, PurePosixPath

import msgspec

from edgemap.runtime.frames.disk import write_atomically
from edgemap.runtime.frames.errors import BundleError
from edgemap.runtime.frames.limits import FILE_BYTES
from edgemap.runtime.frames.reading import decode_json, one_line, read_bytes
from edgemap.runtime.network.layouts import BINS
from edgemap.runtime.network.manifest import Manifest

FORMAT = "edgemap.bundle/1"
MANIFEST_NAME = "bundle.json"


def sha256_file(path: Path) -> str:
    """Hex SHA-256 of a file, read in pieces."""
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def read_manifest(folder: Path) -> Manifest:
    """Read and check `bundle.json`: format, fields, paths that stay inside the folder. Raises BundleError."""
    path = folder / MANIFEST_NAME
    if not folder.is_dir():
        raise BundleError(f"bundle {folder}: no such folder")
    if not path.is_file():
        raise BundleError(f"bundle {folder}: no {MANIFEST_NAME} in it")
    manifest = decode_json(read_bytes(path, BundleError), Manifest, f"bundle {path}", BundleError)
    if manifest.format != FORMAT:
        stated = one_line(repr(manifest.format))
        raise BundleError(f"bundle {path}: format {stated}, this edgemap reads {FORMAT!r}")
    parts = (manifest.detector, *manifest.odometry.values(), *manifest.variants.values())
    files = [part.file for part in parts]
    for name in [*files, *manifest.sha256]:
        if not _is_inside(folder, name):
            raise BundleError(f"bundle {folder}: path {name!r} leaves the bundle's folder")
    for name in files:
        if name not in manifest.sha256:
            raise BundleError(f"bundle {path}: {name} has no sha256")
    check_shapes(path, manifest)
    return manifest


def check_shapes(path: Path, manifest: Manifest) -> None:
    """Raises BundleError where a tensor's shape contradicts the manifest."""
    detector = manifest.detector
    width, height, values = detector.input.width, detector.input.height, 5 + len(detector.classes)
    shapes = detector.outputs()
    for part in manifest.odometry.values():
        shapes |= {state.input: state.shape for state in part.states}
    for name, shape in shapes.items():
        if 4 * math.prod(shape) > FILE_BYTES:
            raise BundleError(f"bundle {path}: tensor {name} of shape {shape}, at most {FILE_BYTES:,} bytes")
    expected: dict[str, tuple[int, ...]] = {}
    if (floor := detector.floor) is not None:
        if floor.labels not in (("floor",), ("floor", "wall")):
            raise BundleError(f"bundle {path}: floor mask {floor.name} has labels {floor.labels}, floor is the first")
        expected[floor.name] = (1, len(floor.labels), height // floor.stride, width // floor.stride)
    for head in detector.heads:
        stride = head.strides[0]
        if detector.decode == "yolov3":
            expected[head.name] = (1, max(len(head.anchors), 1) * values, height // stride, width // stride)
        elif detector.decode == "yolox":
            cells = sum((height // stride) * (width // stride) for stride in head.strides)
            expected[head.name] = (1, cells, values)
        elif detector.decode == "dfl":  # 416 px are 7 cells of stride 64
            expected[head.name] = (1, values + 4 * BINS - 5, -(-height // stride), -(-width // stride))
    for name, shape in expected.items():
        if shapes[name] != shape:
            raise BundleError(
                f"bundle {path}: output {name} has shape {shapes[name]}, but {shape} by its strides, anchors, labels "
                f"and {len(detector.classes)} classes"
            )


def write_manifest(folder: Path, manifest: Manifest, name: str = MANIFEST_NAME) -> None:
    """Writes `bundle.json`, or a file of another name, indented. Raises DiskError."""
    text = msgspec.json.format(msgspec.json.encode(manifest), indent=2)
    write_atomically(folder / name, text + b"\n")


def _is_inside(folder: Path, name: str) -> bool:
    """Whether a path names a file in a folder, links followed, that is not the manifest itself."""
    path = PurePosixPath(name)
    if path.is_absolute() or ".." in path.parts or "\\" in name or path.name in ("", MANIFEST_NAME):
        return False
    try:
        return (folder / path).resolve().is_relative_to(folder.resolve())
    except (OSError, RuntimeError):  # a loop of links
        return False


def verified_file(folder: Path, manifest: Manifest, name: str) -> Path:
    """Path of a bundle's file whose sum has been checked. Raises BundleError naming the file where it differs."""
    path = folder / name
    if not path.is_file():
        raise BundleError(f"bundle {folder}: file {name} is missing")
    try:
        expected, seen = manifest.sha256[name], sha256_file(path)
    except OSError as error:
        raise BundleError(f"bundle {folder}: {name} cannot be read ({error.strerror})") from None
    if seen != expected:
        raise BundleError(f"bundle {folder}: {name} has sha256 {seen[:12]}…, manifest says {expected[:12]}…: damaged")
    return path
