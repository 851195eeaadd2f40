"""Focal length and distortion of an uncalibrated lens, by the usual field of view and the edges of rooms."""

import math

import numpy as np

from edgemap.geometry.arrays import Array
from edgemap.geometry.camera.attitude import RoomAxes
from edgemap.geometry.camera.intrinsics import Distortion, Intrinsics
from edgemap.geometry.camera.room_edges import SIGMA_RAD, level_axes, room_axes
from edgemap.geometry.robust import FEWEST
from edgemap.runtime.motion.attitude.segments import Segments, longest, segments_between

# Of the picture's longer side: webcams, phones that film and the colour cameras of depth cameras have 0.65 to 1.
USUAL_FOCAL, FOCAL_SIGMA = 0.8, 0.22
FOCALS = np.exp(np.linspace(math.log(0.35), math.log(1.5), 24))  # shares that are tried
# Barrel distortion, as the share by which it draws in the middle of the picture's left and right side.
BENDS = (0.0, -0.04, -0.08, -0.12)
# Of the logarithm of the focal length at which one picture's edges agree best: of good ones, the share of these, and of
# the mean (2 % RMS on tuning homes 9000-9004 and 9100). SHOWN_SHARE: of the focal lengths at which a picture must show
# the room.
PEAK_SIGMA, PEAK_SHARE, EDGES_SIGMA, SHOWN_SHARE = 0.05, 0.6, 0.02, 0.5
EDGE_LIMIT, STEEPEST_RAD = 6.0, math.radians(40.0)


def plain_lens(width: int, height: int, share: float, bend: float = 0.0) -> Intrinsics:
    """A lens of square pixels and a centred axis. share: focal length of the longer side. bend: see BENDS."""
    distortion = Distortion("brown_conrady", (bend * 4.0 * share**2,)) if bend else Distortion()
    focal_px = share * max(width, height)
    return Intrinsics(width, height, focal_px, focal_px, (width - 1) / 2.0, (height - 1) / 2.0, distortion)


def focal_by_edges(ends: list[Array], width: int, height: int) -> tuple[float, float, float, str]:
    """Focal length as a share of the longer side, its standard deviation, the bend, and the method in words: the usual
    field of view, or edges of the room where enough pictures show them, whose three directions are orthogonal under the
    right focal length."""
    usual = USUAL_FOCAL, FOCAL_SIGMA, 0.0, "usual field of view"
    agreed = []
    for bend in BENDS:
        peaks = _peaks(ends[::2], width, height, bend)
        agreed.append(float(np.mean(peaks[:, 1])) if len(peaks) else 0.0)
    bend = _vertex(np.array(BENDS), np.array(agreed), int(np.argmax(agreed)))[0]
    peaks = _peaks(ends, width, height, bend)
    if len(peaks) < FEWEST:
        return usual
    # A picture's focal length with the greatest agreement is near the right one, or anywhere.
    logs = np.linspace(math.log(FOCALS[0]), math.log(FOCALS[-1]), 500)
    near = np.exp(-0.5 * ((peaks[:, :1] - logs) / PEAK_SIGMA) ** 2) / (PEAK_SIGMA * math.sqrt(2.0 * math.pi))
    cost = 0.5 * ((logs - math.log(USUAL_FOCAL)) / FOCAL_SIGMA) ** 2
    cost -= np.log(PEAK_SHARE * near + (1.0 - PEAK_SHARE) / np.ptp(logs)).sum(axis=0)
    weights = np.exp(cost.min() - cost)
    weights /= weights.sum()
    mean = float(weights @ logs)
    sigma = math.hypot(EDGES_SIGMA, math.sqrt(float(weights @ (logs - mean) ** 2)))
    return math.exp(mean), sigma, bend, f"usual field of view, edges of {len(peaks)} pictures"


def _peaks(ends: list[Array], width: int, height: int, bend: float) -> Array:
    """For each picture whose edges show the room: logarithm of the focal length (share) with the greatest agreement,
    and that agreement; (N, 2)."""
    lenses, peaks = [plain_lens(width, height, share) for share in FOCALS], []
    bent, straight = plain_lens(width, height, 1.0, bend), plain_lens(width, height, 1.0)
    for lines in ends:
        # A bend is the same pixels under each focal length, so that it is taken out once.
        flat = straight.project(bent.rays(longest(lines, width))).reshape(-1, 2, 2)
        fits = np.array([_explained(flat, lens) for lens in lenses])
        if np.isfinite(fits).mean() >= SHOWN_SHARE:
            peaks.append(_vertex(np.log(FOCALS), fits, int(np.nanargmax(fits))))
    return np.array(peaks).reshape(-1, 2)


def _vertex(places: Array, values: Array, best: int) -> tuple[float, float]:
    """Position and value of the maximum of evenly spaced values, by a parabola through the greatest and its
    neighbours."""
    around = values[max(best - 1, 0) : best + 2]
    if len(around) < 3 or not np.isfinite(around).all():
        return float(places[best]), float(values[best])
    left, middle, right = around.tolist()
    off = 0.5 * (left - right) / min(left - 2.0 * middle + right, -1e-9)
    return float(places[best] + off * (places[1] - places[0])), middle - 0.25 * (left - right) * off


def _explained(lines: Array, lens: Intrinsics) -> float:
    """How well three orthogonal directions explain a picture's edges, per edge; NaN where they show no room.

    Per edge: under a short focal length all edges are longer, so a sum would always prefer it.
    """
    edges, room = _room(lines, lens)
    if room is None or room.level_rad is None:
        return math.nan
    right, away = level_axes(room.up)
    first = math.cos(room.level_rad) * away - math.sin(room.level_rad) * right
    directions = np.stack([room.up, first, np.cross(room.up, first)])
    miss = np.arcsin(np.clip(np.abs(edges.normals @ directions.T).min(axis=1), 0.0, 1.0))
    worth = EDGE_LIMIT - np.minimum((miss / SIGMA_RAD) ** 2, EDGE_LIMIT)
    weight = np.minimum(edges.lengths * lens.fx / (0.15 * lens.width), 2.0)
    return float(weight @ worth / weight.sum())


def ups_by_edges(ends: list[Array], lens: Intrinsics) -> list[Array]:
    """Up directions in the optical frame, (3,) each, of the pictures whose edges show the room."""
    rooms = (_room(lines, lens)[1] for lines in ends)
    return [room.up for room in rooms if room is not None]


def _room(lines: Array, lens: Intrinsics) -> tuple[Segments, RoomAxes | None]:
    """A picture's edges, and the room's axes that they show, near to the picture's own up."""
    edges = segments_between(lines, lens)
    if not len(edges):
        return edges, None
    return edges, room_axes(edges.normals, edges.lengths, np.array([0.0, -1.0, 0.0]), STEEPEST_RAD)
