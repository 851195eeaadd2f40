"""Reads, checks and writes a bundle's `bundle.json`, and checks the sums of its files."""

import hashlib
import math
from pathlib import Path, PurePosixPath

import msgspec

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
        _inside(folder, name)
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
    if (floor := detector.floor) is not None:
        expected = (1, len(floor.labels), height // floor.stride, width // floor.stride)
        if floor.labels not in (("floor",), ("floor", "wall")):
            raise BundleError(f"bundle {path}: floor mask {floor.name} has labels {floor.labels}, floor is the first")
        if floor.shape != expected:
            raise BundleError(
                f"bundle {path}: floor mask {floor.name} has shape {floor.shape}, {len(floor.labels)} labels at stride "
                f"{floor.stride} have {expected}"
            )
    for head in detector.heads:
        expected = head.shape
        if detector.decode == "yolov3":
            (stride, *others), anchors = head.strides, len(head.anchors)
            expected = (1, max(anchors, 1) * values, height // stride, width // stride) if not others else ()
        elif detector.decode == "yolox":
            expected = (1, sum((height // stride) * (width // stride) for stride in head.strides), values)
        elif detector.decode == "dfl":
            (stride, *others) = head.strides
            rows, columns = -(-height // stride), -(-width // stride)  # 416 px are 7 cells of stride 64
            expected = (1, values + 4 * BINS - 5, rows, columns) if not others else ()
        if head.shape != expected:
            raise BundleError(
                f"bundle {path}: head {head.name} has shape {head.shape}, {detector.decode} with {len(head.anchors)} "
                f"anchors, strides {head.strides} and {len(detector.classes)} classes has {expected}"
            )


def write_manifest(folder: Path, manifest: Manifest, name: str = MANIFEST_NAME) -> None:
    """Writes `bundle.json`, or a file of another name, indented. Raises OSError."""
    text = msgspec.json.format(msgspec.json.encode(manifest), indent=2)
    (folder / name).write_bytes(text + b"\n")


def _inside(folder: Path, name: str) -> Path:
    parts = PurePosixPath(name)
    path, odd = folder / parts, parts.is_absolute() or ".." in parts.parts or "\\" in name
    try:
        inside = not odd and path.resolve().is_relative_to(folder.resolve())
    except (OSError, RuntimeError):  # a loop of links
        inside = False
    if not inside or not parts.parts or parts.name == MANIFEST_NAME:
        raise BundleError(f"bundle {folder}: path {name!r} leaves the bundle's folder")
    return path


def verified_file(folder: Path, manifest: Manifest, name: str) -> Path:
    """Path of a bundle's file whose sum has been checked. Raises BundleError naming the file where it differs."""
    path = _inside(folder, name)
    if not path.is_file():
        raise BundleError(f"bundle {folder}: file {name} is missing")
    try:
        expected, seen = manifest.sha256[name], sha256_file(path)
    except OSError as error:
        raise BundleError(f"bundle {folder}: {name} cannot be read ({error.strerror})") from None
    if seen != expected:
        raise BundleError(f"bundle {folder}: {name} has sha256 {seen[:12]}…, manifest says {expected[:12]}…: damaged")
    return path
