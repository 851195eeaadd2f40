"""Pitch and height of an uncalibrated camera, by the usual sizes of the objects in its pictures."""

import math
from dataclasses import replace

import numpy as np

from edgemap.geometry.arrays import Array
from edgemap.geometry.camera.floor import FloorCamera
from edgemap.geometry.camera.intrinsics import Intrinsics
from edgemap.geometry.camera.mount import Mount
from edgemap.geometry.observations.class_extents import HEIGHT_M, MEASURED
from edgemap.geometry.observations.detections import Detections
from edgemap.geometry.observations.lens_height import BORDER_PX, lens_heights

USUAL_PITCH_RAD, PITCH_SIGMA_RAD = math.radians(8.0), math.radians(10.0)  # of robots' cameras, without edges
USUAL_HEIGHT_M, HEIGHT_SIGMA = 0.6, 0.7  # of the lens, and of its logarithm
CARRIED_HEIGHT_M, CARRIED_SIGMA = 1.5, 0.15  # of a camera in a person's hands, before the chest, or on the head
TRIED_PITCH_RAD = np.radians(np.arange(-10.0, 46.0, 1.0))
FARTHEST_HEIGHTS = 15.0  # farther than so many lens heights, pitch decides alone


def pitch_by_sizes(
    boxes: list[Detections], lens: Intrinsics, usual: tuple[float, float] | None
) -> tuple[float, float, int]:
    """The pitch at which objects of usual heights agree on the lens's height: pitch, its sigma, and how many there are.
    usual: height of the lens and the sigma of its logarithm, where it is known that well.

    Maximum posterior on a grid, with the usual pitch as prior; near and far objects disagree at a wrong one.
    """
    costs, counts = [], []
    for pitch in TRIED_PITCH_RAD.tolist():
        logs, sigmas = _logs(boxes, lens, Mount(1.0, pitch))
        cost = 0.5 * ((pitch - USUAL_PITCH_RAD) / PITCH_SIGMA_RAD) ** 2
        if usual is not None:
            cost += float(np.log1p(((logs - math.log(usual[0])) / np.hypot(sigmas, usual[1])) ** 2).sum())
        elif len(logs) > 1:
            cost += float(np.log1p(((logs - np.median(logs)) / sigmas) ** 2).sum())
        costs.append(cost)
        counts.append(len(logs))
    # A pitch at which boxes drop out must not gain by it: each one that is missing costs as much as a bad one.
    total = np.array(costs) + 2.0 * (max(counts) - np.array(counts))
    weights = np.exp(-(total - total.min()))
    weights /= weights.sum()
    mean = float(weights @ TRIED_PITCH_RAD)
    sigma = math.sqrt(float(weights @ (TRIED_PITCH_RAD - mean) ** 2) + math.radians(1.0) ** 2)
    return mean, sigma, max(counts)


def height_by_sizes(
    boxes: list[Detections], lens: Intrinsics, tilted: Mount, pitch_sigma: float, usual: tuple[float, float]
) -> tuple[float, float, int]:
    """Lens above the floor, m; its sigma as a share; and how many objects show it. usual: without them."""
    information = usual[1] ** -2
    if (shown := _shown_height(boxes, lens, tilted)) is None:
        return *usual, 0
    mean, variance, count = shown
    pitches = tilted.pitch_rad - pitch_sigma, tilted.pitch_rad + pitch_sigma
    turned = [_shown_height(boxes, lens, replace(tilted, pitch_rad=pitch)) for pitch in pitches]
    logs = [mean if one is None else one[0] for one in turned]
    variance += (0.5 * (logs[1] - logs[0])) ** 2
    total = information + 1.0 / variance
    return math.exp((math.log(usual[0]) * information + mean / variance) / total), total**-0.5, count


def _shown_height(boxes: list[Detections], lens: Intrinsics, tilted: Mount) -> tuple[float, float, int] | None:
    """Logarithm of the lens's height, its variance, and how many objects show it; None where none does. Each class
    counts as one observation with the scatter of its kind, as objects of a class are alike within a home."""
    camera, by_kind = FloorCamera(lens, tilted), dict[tuple[str, float], list[float]]()
    for found in boxes:
        for one in lens_heights(found, camera):
            by_kind.setdefault((one.label, HEIGHT_M[one.label][1]), []).append(math.log(one.height_m))
        for label, height_m in _by_widths(found, camera):
            shape = MEASURED[label]
            by_kind.setdefault((label, shape.width_sigma / shape.width), []).append(math.log(height_m))
    means, information = list[float](), list[float]()
    for (_, kind_sigma), logs in by_kind.items():
        spread = 1.48 * float(np.median(np.abs(np.array(logs) - np.median(logs)))) + 0.1
        means.append(float(np.median(logs)))
        information.append(1.0 / (kind_sigma**2 + spread**2 / len(logs) + 0.05**2))
    if not means:
        return None
    weights = np.array(information)
    return float(weights @ means / weights.sum()), 1.0 / float(weights.sum()), sum(map(len, by_kind.values()))


def _by_widths(found: Detections, camera: FloorCamera) -> list[tuple[str, float]]:
    """Label and the lens's height by each box of a class of usual width that stands on the floor uncut at its foot and
    sides: what is high, near and cut above shows a low lens. camera: 1 m above the floor."""
    shapes, seen = [MEASURED.get(label) for label in found.labels], []
    for row, shape in enumerate(shapes):
        left, _, right, foot = found.boxes[row].tolist()
        inside = (
            left > BORDER_PX
            and right < camera.intrinsics.width - BORDER_PX
            and foot < camera.intrinsics.height - BORDER_PX
        )
        if shape is None or not inside:
            continue
        ends = camera.floor_points([(left, foot - 0.5), (right, foot - 0.5)])
        wide_m = float(np.linalg.norm(ends[1] - ends[0]))
        if np.isfinite(ends).all() and np.linalg.norm(ends.mean(axis=0)) < FARTHEST_HEIGHTS:
            seen.append((found.labels[row], shape.width / max(wide_m, 1e-3)))
    return seen


def _logs(boxes: list[Detections], lens: Intrinsics, tilted: Mount) -> tuple[Array, Array]:
    """Logarithm of the lens's height by each object, and its sigma."""
    camera = FloorCamera(lens, tilted)
    found = [one for detections in boxes for one in lens_heights(detections, camera)]
    return (
        np.array([math.log(one.height_m) for one in found]),
        np.array([math.hypot(HEIGHT_M[one.label][1], 0.1) for one in found]),
    )
