"""Pitch and height of an uncalibrated camera, by the usual sizes of the objects in its pictures."""

import math

import numpy as np

from edgemap.geometry.arrays import Array
from edgemap.geometry.camera.floor import FloorCamera
from edgemap.geometry.camera.intrinsics import Intrinsics
from edgemap.geometry.camera.mount import Mount
from edgemap.geometry.observations.class_extents import HEIGHT_M
from edgemap.geometry.observations.detections import Detections
from edgemap.geometry.observations.lens_height import (
    HeightBySizes,
    HeightMeasurement,
    agreed_height,
    complete_boxes,
    lens_heights,
)

USUAL_PITCH_RAD, PITCH_SIGMA_RAD = math.radians(8.0), math.radians(10.0)  # of robots' cameras, without edges
USUAL_HEIGHT_M, HEIGHT_SIGMA = 0.6, 1.0  # of the lens, and of its logarithm
CARRIED_HEIGHT_M, CARRIED_SIGMA = 1.5, 0.15  # of a camera in a person's hands, before the chest, or on the head
TRIED_PITCH_RAD = np.radians(np.arange(-10.0, 46.0, 1.0))


def pitch_by_sizes(
    boxes: list[Detections], lens: Intrinsics, usual: tuple[float, float] | None
) -> tuple[float, float, int]:
    """The pitch at which objects of usual heights agree on the lens's height: pitch, its sigma, and how many there are.
    usual: height of the lens and the sigma of its logarithm, where it is that certain.

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
    camera, sizes = FloorCamera(lens, tilted), HeightBySizes(len(boxes))
    for detections in boxes:
        sizes.add(detections, camera)
    before = HeightMeasurement("usual", math.log(usual[0]), usual[1])
    log_m, sigma = agreed_height([before, *sizes.measurements(pitch_sigma)])
    return math.exp(log_m), sigma, sizes.count


def _logs(boxes: list[Detections], lens: Intrinsics, tilted: Mount) -> tuple[Array, Array]:
    """Logarithm of the lens's height by each object, and its sigma."""
    camera = FloorCamera(lens, tilted)
    found = [complete_boxes(detections, camera) for detections in boxes]
    labels = [label for some, _ in found for label in some]
    heights_m, _ = lens_heights(labels, np.concatenate([np.zeros((0, 2, 3)), *(rays for _, rays in found)]))
    return np.log(heights_m), np.array([math.hypot(HEIGHT_M[label][1], 0.1) for label in labels])
