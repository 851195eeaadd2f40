"""Camera files of other programs: ROS, Kalibr (and EuRoC), OpenCV, ORB-SLAM, COLMAP and nerfstudio, one reader each."""

import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from edgemap.geometry.camera.intrinsics import Distortion, Intrinsics
from edgemap.geometry.errors import GeometryError
from edgemap.runtime.frames.errors import CameraError
from edgemap.runtime.frames.reading import Side, convert, decode_json, one_line, read_text
from edgemap.runtime.frames.yaml_file import read_yaml

Tree = Mapping[str, Any]
OPENCV_KEYS = {  # in small letters without underscores
    "matrix": ("cameramatrix", "intrinsicmatrix", "k", "m1", "m"),
    "coefficients": ("distortioncoefficients", "distcoeffs", "distcoeff", "distortion", "d", "d1"),
    "width": ("imagewidth", "width"),
    "height": ("imageheight", "height"),
    "size": ("imagesize", "resolution"),
}
BROWN, RATIONAL = "k1 k2 p1 p2 k3", "k1 k2 p1 p2 k3 k4 k5 k6"
NERFSTUDIO = ("camera_model", "is_fisheye", "w", "h", "fl_x", "fl_y", "cx", "cy", "camera_angle_x", *RATIONAL.split())
COLMAP = {
    "SIMPLE_PINHOLE": ("none", "f cx cy"),
    "PINHOLE": ("none", "fx fy cx cy"),
    "SIMPLE_RADIAL": ("opencv", "f cx cy k1"),
    "RADIAL": ("opencv", "f cx cy k1 k2"),
    "OPENCV": ("opencv", "fx fy cx cy k1 k2 p1 p2"),
    "FULL_OPENCV": ("full_opencv", f"fx fy cx cy k1 k2 p1 p2 {RATIONAL[12:]}"),
    "OPENCV_FISHEYE": ("fisheye", "fx fy cx cy k1 k2 k3 k4"),
    "SIMPLE_RADIAL_FISHEYE": ("fisheye", "f cx cy k1"),
    "RADIAL_FISHEYE": ("fisheye", "f cx cy k1 k2"),
}


def read_foreign_lens(path: Path) -> Intrinsics | None:
    """The lens in a camera file of another program; None for one that is none of them. Raises CameraError, one line
    with the path, for a model that is not supported and for what is missing."""
    tree = _tree(path)
    for recognised, read in READERS:
        if tree is not None and recognised(tree):
            try:
                return read(tree)
            except (GeometryError, CameraError) as error:
                raise CameraError(f"{path}: {error}") from None
            except (LookupError, TypeError, ValueError, AttributeError, OverflowError) as error:
                raise CameraError(f"{path}: not a camera file that is read ({one_line(error)})") from None
    return None


def _tree(path: Path) -> Tree | None:
    """The file as plain values; `cameras` are the lines of COLMAP's text."""
    if path.suffix == ".json":
        tree = decode_json(read_text(path, CameraError), object, path, CameraError)
    elif path.suffix == ".txt":
        lines = (line.split() for line in read_text(path, CameraError).splitlines())
        tree = {"cameras": [line for line in lines if line and not line[0].startswith("#")]}
    elif path.is_file() and path.suffix in (".yml", ".yaml"):
        tree = read_yaml(path, CameraError)
    elif path.suffix == ".xml":
        raise CameraError(f"{path}: XML is not read: let OpenCV write the same as .yml")
    else:
        return None
    return tree if isinstance(tree, Mapping) else None


def _of_kalibr(tree: Tree) -> Intrinsics:
    camera = tree.get("cam0", tree)
    if (model := str(camera.get("camera_model", "pinhole"))) != "pinhole":
        raise CameraError(f"camera_model {one_line(model, 40)!r} is not supported (pinhole is)")
    coefficients = camera.get("distortion_coeffs", camera.get("distortion_coefficients", []))
    usual = "radtan" if coefficients else "none"
    distortion = Distortion.named(str(camera.get("distortion_model", usual)), coefficients)
    return _lens(camera["resolution"], camera["intrinsics"], distortion)


def _of_opencv(tree: Tree) -> Intrinsics:
    """ROS's too, whose matrices are mappings with `data`."""
    plain = {key.lower().replace("_", ""): value for key, value in tree.items()}
    values = {what: next((plain[key] for key in keys if key in plain), None) for what, keys in OPENCV_KEYS.items()}
    size = values["size"] or (values["width"], values["height"])
    if None in size:
        raise CameraError("lacks the size of the pictures; add image_width: 640 and image_height: 480, as they are")
    if values["coefficients"] is None:
        raise CameraError("lacks the distortion; add distortion_coefficients: [] where there is none")
    roi = tree.get("roi") or {}
    if max(tree.get("binning_x", 0), tree.get("binning_y", 0)) > 1 or any(map(roi.get, ("x_offset", "y_offset"))):
        raise CameraError("is of binned or cut pictures; write the camera matrix of the pictures as they are")
    matrix, coefficients = (_numbers(values[what]) for what in ("matrix", "coefficients"))
    usual = "fisheye" if tree.get("fisheye_model") else "plumb_bob" if len(coefficients) <= 5 else "rational_polynomial"
    model = str(tree.get("distortion_model") or tree.get("camera_model") or usual)
    distortion = Distortion.named(usual if model == "pinhole" else model, coefficients)
    if len(matrix) != 9 or any(abs(matrix[place]) > 1.0 for place in (1, 3, 6, 7)):
        raise CameraError(f"camera matrix {one_line(matrix)}, expected fx, 0, cx, 0, fy, cy, 0, 0, 1")
    return _lens(size, [matrix[place] for place in (0, 4, 2, 5)], distortion)


def _numbers(matrix: Any) -> Sequence[float]:
    """Those of a matrix as FileStorage writes it, or of a list, or of one of rows."""
    return np.ravel(matrix["data"] if isinstance(matrix, Mapping) else matrix).astype(float).tolist()


def _of_orb_slam(tree: Tree) -> Intrinsics:
    prefix = "Camera1" if "Camera1.fx" in tree else "Camera"
    if "Camera.width" not in tree or "Camera.height" not in tree:
        raise CameraError("lacks the size of the pictures; add Camera.width: 640 and Camera.height: 480, as they are")
    kind = str(tree.get("Camera.type", "PinHole"))
    names = {"pinhole": BROWN, "rectified": "", "kannalabrandt8": "k1 k2 k3 k4"}.get(kind.lower())
    if names is None:
        raise CameraError(f"Camera.type {one_line(kind, 40)!r} is not supported")
    coefficients = [float(tree.get(f"{prefix}.{name}", 0.0)) for name in names.split()]
    distortion = Distortion.named(kind if kind.lower() == "kannalabrandt8" else "radtan", coefficients)
    numbers = [tree[f"{prefix}.{name}"] for name in ("fx", "fy", "cx", "cy")]
    return _lens((tree["Camera.width"], tree["Camera.height"]), numbers, distortion)


def _of_colmap(tree: Tree) -> Intrinsics:
    if len({tuple(line[1:]) for line in tree["cameras"]}) != 1:
        raise CameraError(f"{len(tree['cameras'])} cameras in it; leave the line of the one that is meant")
    _, model, width, height, *numbers = tree["cameras"][0]
    if model not in COLMAP:
        raise CameraError(f"COLMAP's model {one_line(model, 40)!r} is not supported ({', '.join(COLMAP)} are)")
    named, names = COLMAP[model]
    values = dict(zip(names.split(), map(float, numbers), strict=True))
    return _from_corner((width, height), values, named)


def _of_nerfstudio(tree: Tree) -> Intrinsics:
    lenses = [{key: frame[key] for key in NERFSTUDIO if key in frame} for frame in tree.get("frames") or [{}]]
    if any(lens != lenses[0] for lens in lenses):
        raise CameraError("its frames are of several lenses; leave those of the one that is meant")
    values = {**lenses[0], **tree}
    model = str(values.get("camera_model", "OPENCV_FISHEYE" if values.get("is_fisheye") else "OPENCV"))
    named, names = COLMAP.get(model, ("", ""))
    if not names:
        raise CameraError(f"camera_model {one_line(model, 40)!r} is not supported ({', '.join(COLMAP)} are)")
    width, height = values["w"], values["h"]
    angle = values.get("camera_angle_x")
    fx = values["fl_x"] if "fl_x" in values or angle is None else width / 2.0 / math.tan(angle / 2.0)
    numbers = {"fx": fx, "fy": values.get("fl_y", fx), "cx": values.get("cx", width / 2.0)}
    numbers |= {"cy": values.get("cy", height / 2.0), **{name: values.get(name, 0.0) for name in RATIONAL.split()}}
    return _from_corner((width, height), {name: float(value) for name, value in numbers.items()}, named)


def _from_corner(size: Sequence[Any], values: dict[str, float], model: str) -> Intrinsics:
    """A lens by named numbers, whose principal point counts from the corner of the first pixel."""
    focal = values.get("fx", values.get("f")), values.get("fy", values.get("f"))
    order = {"none": "", "fisheye": "k1 k2 k3 k4"}.get(model, RATIONAL)
    coefficients = [values.get(name, 0.0) for name in order.split()]
    distortion = Distortion.named("rational" if order == RATIONAL else model, coefficients)
    return _lens(size, (*focal, values["cx"] - 0.5, values["cy"] - 0.5), distortion)


def _lens(size: Sequence[Any], numbers: Sequence[Any], distortion: Distortion) -> Intrinsics:
    width, height = convert([*size], tuple[Side, Side], "size", CameraError, strict=False)
    fx, fy, cx, cy = map(float, numbers)
    return Intrinsics(width, height, fx, fy, cx, cy, distortion)


READERS: tuple[tuple[Callable[[Tree], bool], Callable[[Tree], Intrinsics]], ...] = (
    (lambda tree: "cameras" in tree, _of_colmap),
    (lambda tree: "fl_x" in tree or "camera_angle_x" in tree or "frames" in tree, _of_nerfstudio),
    (lambda tree: "Camera.fx" in tree or "Camera1.fx" in tree, _of_orb_slam),
    (lambda tree: "cam0" in tree or ("intrinsics" in tree and "resolution" in tree), _of_kalibr),
    (lambda tree: any(key.lower().replace("_", "") in OPENCV_KEYS["matrix"] for key in tree), _of_opencv),
)
