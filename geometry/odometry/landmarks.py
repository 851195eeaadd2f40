"""Landmarks of tracked points (bearing, inverse depth, variance), and the camera's pose among them."""

import math
from dataclasses import dataclass, field, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.camera.floor import FloorCamera
from edgemap.geometry.odometry.rolling import Rolling
from edgemap.geometry.se2 import SE2, wrap_angle

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class AttitudeError:
    """Rotation of the camera against its mount in one picture: small angles about left (nose down) and forward."""

    pitch_rad: float = 0.0
    roll_rad: float = 0.0

    def rotation(self) -> Array:
        """3x3, applied to directions of the base frame after the mount's rotation."""
        cp, sp = math.cos(self.pitch_rad), math.sin(self.pitch_rad)
        cr, sr = math.cos(self.roll_rad), math.sin(self.roll_rad)
        return np.array([[cp, sp * sr, sp * cr], [0.0, cr, -sr], [-sp, cp * sr, cp * cr]])


@dataclass(frozen=True, slots=True)
class Viewpoint:
    """Pose of the base in the landmarks' frame, and tilt of the camera there. rise_m: of the lens above the mount's
    height."""

    pose: SE2 = field(default_factory=SE2)
    tilt: AttitudeError = AttitudeError()
    rise_m: float = 0.0


def rotated(tilt: AttitudeError, before: FloorCamera, rotation: Array, after: FloorCamera) -> AttitudeError:
    """Tilt of a camera against the mount of `after`, from its tilt against that of `before` and its rotation since.

    rotation: (3, 3), takes optical directions of now into those of before, as a gyro measures it.
    """
    base = tilt.rotation() @ before.mount.rotation_base_optical() @ rotation @ after.mount.rotation_base_optical().T
    pitch_rad = math.asin(min(max(-float(base[2, 0]), -1.0), 1.0))
    return AttitudeError(pitch_rad, math.atan2(base[2, 1], base[2, 2]))


def rotation_between(before: Viewpoint, camera_before: FloorCamera, after: Viewpoint, camera: FloorCamera) -> Array:
    """(3, 3), takes optical directions of the later view into those of the earlier one."""
    base_before = before.tilt.rotation() @ camera_before.mount.rotation_base_optical()
    base_after = after.tilt.rotation() @ camera.mount.rotation_base_optical()
    return base_before.T @ _rotation_z(before.pose.inverse() @ after.pose) @ base_after


def displacement(before: Viewpoint, camera_before: FloorCamera, after: Viewpoint, camera: FloorCamera) -> Array:
    """Displacement of the lens, (3,), in the optical axes of the earlier view; unit as of the poses."""
    base = _rotation_z(before.pose).T @ (_lens_at(camera, after) - _lens_at(camera_before, before))
    return base @ before.tilt.rotation() @ camera_before.mount.rotation_base_optical()


@dataclass(frozen=True, slots=True)
class Noise:
    """Standard deviations."""

    track_rad: float  # of a track's position in one picture
    drift_rad: float  # of a track's drift per picture, as its template is renewed
    tilt_rad: float = math.radians(0.2)  # of pitch and roll in one picture
    floor_tilt_rad: float = math.radians(0.1)  # of the tilt once it is estimated
    scale: float = 0.05  # relative, of the common scale per picture of points off the floor
    unknown_mean: float = 0.2  # inverse depth of a new point, 1/m: its mean, not a deviation
    unknown: float = 0.3  # of the inverse depth of a new point about unknown_mean, 1/m
    rise_m: float = 1e-4  # of the lens's height, from one picture to the next


@dataclass(slots=True, eq=False)
class Landmarks:
    """N points, each on the ray of its first observation, in one fixed frame with the floor at z = 0. anchor_m (N, 3):
    where the lens was. ray (N, 3): unit direction. inverse_m (N,): one over the distance along it, variance (N,) of
    that. floor (N,): whether it counts as floor. on_floor (N,): the inverse depth that it would have on the floor, for
    undecided points below the horizon; 0 for others. age (N,): pictures since its first observation.
    """

    anchor_m: Array
    ray: Array
    inverse_m: Array
    variance: Array
    floor: NDArray[np.bool_]
    on_floor: Array
    age: NDArray[np.int64]

    @classmethod
    def none(cls) -> "Landmarks":
        """No landmark."""
        none, vectors = np.zeros(0), np.zeros((0, 3))
        empty = np.zeros(0, bool)
        return cls(vectors, vectors, none, none, empty, none, np.zeros(0, int))

    def __len__(self) -> int:
        return len(self.inverse_m)

    def chosen(self, which: NDArray[np.bool_]) -> "Landmarks":
        """The landmarks at which the mask (N,) is set."""
        return Landmarks(*(getattr(self, f.name)[which] for f in fields(self)))

    def joined(self, other: "Landmarks") -> "Landmarks":
        """These and then the others."""
        return Landmarks(*(np.concatenate([getattr(self, f.name), getattr(other, f.name)]) for f in fields(self)))


def new_landmarks(
    rays: Array,
    camera: FloorCamera,
    view: Viewpoint,
    noise: Noise,
    reach_m: float,
    trusting: bool | NDArray[np.bool_] = True,
) -> Landmarks:
    """New landmarks along optical rays (N, 3) from a view, on the floor where the ray meets it within reach. trusting:
    whether they (N,) count as floor at once; otherwise their depth must confirm it, since a table is below the horizon
    too.
    """
    base = rays @ camera.mount.rotation_base_optical().T @ view.tilt.rotation().T
    base /= np.linalg.norm(base, axis=1)[:, None]
    lens = _lens(camera, view)
    on_floor = -base[:, 2] / lens[2]
    reached = on_floor > 1.0 / reach_m
    floor = reached & trusting
    sigma = noise.floor_tilt_rad * np.hypot(base[:, 0], base[:, 1]) / lens[2]
    inverse = np.where(floor, on_floor, np.maximum(noise.unknown_mean, on_floor))
    variance = np.where(floor, sigma**2, np.maximum(noise.unknown, 0.5 * on_floor) ** 2)
    rotation = _rotation_z(view.pose)
    anchor = rotation @ lens + [view.pose.x_m, view.pose.y_m, 0.0]
    count = len(rays)
    return Landmarks(
        np.broadcast_to(anchor, (count, 3)), base @ rotation.T, inverse, variance, floor,
        np.where(reached & ~floor, on_floor, 0.0), np.zeros(count, dtype=np.int64),
    )  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class Projection:
    """Landmarks projected into a view, with Jacobians. predicted (N, 2): normalised image points;
    by_view (N, 2, 6): per metre forward and left, radian of yaw, pitch and roll, metre of rise; by_inverse (N, 2): per
    1/m. ahead (N,): in front.
    """

    predicted: Array
    by_view: Array
    by_inverse: Array
    ahead: NDArray[np.bool_]


def project(landmarks: Landmarks, camera: FloorCamera, view: Viewpoint) -> Projection:
    """Landmarks projected from a view, with the Jacobians that `locate` needs (perturbed in the view's base frame)."""
    rotation = _rotation_z(view.pose)
    lens = _lens(camera, view)
    to_optical = (view.tilt.rotation() @ camera.mount.rotation_base_optical()).T
    away = (landmarks.anchor_m - [view.pose.x_m, view.pose.y_m, 0.0]) @ rotation
    inverse = landmarks.inverse_m
    base = landmarks.ray @ rotation + inverse[:, None] * away
    lensed = base - inverse[:, None] * lens
    moved = np.zeros((3, 8, len(inverse)))  # base-frame change per parameter; last: per inverse depth, and the point
    moved[0, 0] = moved[1, 1] = -inverse
    moved[0, 2], moved[1, 2] = base[:, 1], -base[:, 0]
    moved[0, 3], moved[2, 3] = -lensed[:, 2], lensed[:, 0]
    moved[1, 4], moved[2, 4] = lensed[:, 2], -lensed[:, 1]
    moved[2, 5] = -inverse
    moved[:, 6], moved[:, 7] = (away - lens).T, lensed.T
    optical = (to_optical @ moved.reshape(3, -1)).reshape(moved.shape)
    depth = optical[2, 7]
    ahead = depth > 0.02
    depth = np.where(ahead, depth, 1.0)
    predicted = optical[:2, 7] / depth
    by = (optical[:2, :7] - predicted[:, None] * optical[2, :7]) / depth
    return Projection(predicted.T, by[:, :6].transpose(2, 0, 1), by[:, 6].T, ahead)


@dataclass(frozen=True, slots=True, eq=False)
class Located:
    """view: the estimated pose. covariance: (6, 6) of it in its base frame, (m, m, rad, rad, rad, m), for fixed
    landmarks. weights (N,): 0 for a track that does not fit. residual (N, 2), projection: at that view. scale: relative
    correction of the inverse depths off the floor. lateral: m and m^2, lateral motion from the floor alone and its
    variance, None where little floor is in view. slid: whether that contradicts rolling.
    """

    view: Viewpoint
    covariance: Array
    weights: Array
    residual: Array
    projection: Projection
    scale: float
    lateral: tuple[float, float] | None = None
    slid: bool = False


TUKEY = 16.0  # squared, in units of the expected residual; beyond it a track has no weight
ANNEALING = (6.0, 3.0, 1.5, 1.0, 1.0)


def locate(
    landmarks: Landmarks,
    observed: Array,
    camera: FloorCamera,
    start: Viewpoint,
    noise: Noise,
    doubtful: NDArray[np.bool_] | None = None,
    rolling: tuple[SE2, Rolling] | None = None,
) -> Located:
    """The view that best fits the observed points, (N, 2) normalised image points: robust Gauss-Newton from a start.

    A landmark's uncertain depth widens its expected residual along its epipolar line, so a far or new one constrains
    the rotation only. `noise` is the prior of pitch, roll and rise about the start's. Points off the floor keep their
    shape; their common scale may change within `noise.scale`, so that the floor determines it. Tukey's weights, scale
    annealed. doubtful (N,): points on objects that may move, used only once the others have determined the view.
    rolling: the last picture's pose and how the robot rolled on from it, unless much floor in view shows that it slid.
    A common error of the depths moves the lens sideways in a turn, which the covariance does not show: the more the
    landmarks contradict rolling, the larger are its weight and the covariance.
    """
    projection = project(landmarks, camera, start)
    sure = np.ones(len(observed), dtype=bool) if doubtful is None or doubtful.all() else ~doubtful
    view, log_scale = _rotated_to(projection, observed, start, sure), 0.0
    weights, distance2 = np.zeros(len(observed)), np.zeros(len(observed))
    residual, inverse = observed, np.eye(7)
    off_floor = np.where(landmarks.floor, 0.0, landmarks.inverse_m)
    sigma2 = np.asarray(noise.track_rad**2 + noise.drift_rad**2 * landmarks.age, dtype=np.float64)
    tight = noise.tilt_rad**-2
    prior = np.array([tight, tight, noise.rise_m**-2, noise.scale**-2])
    damped = np.diag([1e-2, 1e-2, 1e-2, *prior])
    across_m, variance_m2, conflict, worst = 0.0, 0.0, 1.0, 1.0  # of landmarks alone; worst: before reweighting
    before, how = rolling or (SE2(), None)
    for scale in ANNEALING:
        scaled = replace(landmarks, inverse_m=landmarks.inverse_m + log_scale * off_floor)
        projection = project(scaled, camera, view)
        residual = observed - projection.predicted
        white, jacobian = _whitened(projection, residual, off_floor, landmarks.variance, sigma2)
        distance2 = (white**2).sum(axis=0)
        counts = projection.ahead & (sure | (scale <= 1.0))
        weights = np.where(counts, np.clip(1.0 - distance2 / (TUKEY * scale**2), 0.0, 1.0) ** 2, 0.0)
        weighted = jacobian * weights
        information = (weighted @ jacobian.transpose(0, 2, 1)).sum(axis=0) + damped
        gradient = (weighted @ white[:, :, None]).sum(axis=(0, 2))
        beyond = view.tilt.pitch_rad - start.tilt.pitch_rad, view.tilt.roll_rad - start.tilt.roll_rad
        gradient[3:] -= prior * [*beyond, view.rise_m - start.rise_m, log_scale]
        inverse = np.asarray(np.linalg.inv(information), dtype=np.float64)
        if how is not None:
            lateral = how.lateral(before.inverse() @ view.pose)
            along = inverse[:, :3] @ lateral.by_motion
            across_m = lateral.residual_m + float(along @ gradient)
            variance_m2 = float(along[:3] @ lateral.by_motion)
            contradiction = across_m**2 / (variance_m2 + lateral.variance_m2)
            worst, conflict = max(worst, contradiction), max(contradiction / OVERRULED, 1.0)
            gradient[:3] -= lateral.by_motion * conflict * lateral.residual_m / lateral.variance_m2
            inverse -= np.outer(along, along) / (lateral.variance_m2 / conflict + variance_m2)  # Sherman and Morrison
        step = inverse @ gradient
        view, log_scale = _moved(view, step), float(np.clip(log_scale + step[6], -0.3, 0.3))
    degrees = max(2.0 * weights.sum() - 6.0, 1.0)
    excess = max(1.0, float((weights * distance2).sum()) / degrees)
    shows, measured = landmarks.floor, None
    if how is not None and worst > LATERAL_GATE:
        slid = locate(landmarks, observed, camera, start, noise, doubtful)
        lateral = how.lateral(before.inverse() @ slid.view.pose)
        contrary = lateral.residual_m, float(lateral.by_motion @ slid.covariance[:3, :3] @ lateral.by_motion)
        turn_rad = wrap_angle(slid.view.pose.yaw_rad - before.yaw_rad)
        doubt = LATERAL_GATE * (contrary[1] + lateral.variance_m2) + (TURN_M * turn_rad) ** 2
        if float(slid.weights[shows].sum()) > SHOWS_LATERAL and contrary[0] ** 2 > doubt:
            return replace(slid, lateral=contrary, slid=True)
    elif how is not None and float(weights[shows].sum()) > SHOWS_LATERAL:
        measured = across_m, variance_m2 * excess
    return Located(view, inverse[:6, :6] * (excess * conflict), weights, residual, projection, log_scale, measured)


SHOWS_LATERAL = 30.0  # landmarks on the floor that show how the robot moves across its heading
OVERRULED = 9.0  # squared, in standard deviations; landmarks that contradict rolling by more count less
LATERAL_GATE = 25.0  # squared, in standard deviations
TURN_M = 0.3  # of motion that a radian of turn counts as, and by which pictures confuse the two


# Relative standard deviation of an inverse depth below which neighbouring new landmarks start with it, and of theirs
# about it.
NEIGHBOUR_DEPTH = 0.3
UNKNOWN_NEIGHBOURS = 0.5  # weight of `Noise.unknown_mean` among the neighbours of a new landmark


def with_neighbours_depth(
    new: Landmarks, near: Array, old: Landmarks, camera: FloorCamera, view: Viewpoint, noise: Noise
) -> Landmarks:
    """New landmarks, all observed in this view, with the mean inverse depth of neighbouring old ones.

    near: (new, old), 0..1, weights by their distance in the picture. Otherwise new landmarks pull the common scale
    towards `Noise.unknown_mean` where no floor is in view. None lies beyond the floor.
    """
    lens = _lens_at(camera, view)
    away = old.ray + old.inverse_m[:, None] * (old.anchor_m - lens)
    inverse = old.inverse_m / np.maximum(np.linalg.norm(away, axis=1), 1e-6)
    near = near * ((np.sqrt(old.variance) < NEIGHBOUR_DEPTH * old.inverse_m) & (inverse > 0.0))
    total = near.sum(axis=1)
    divisor = np.maximum(total, 1e-9)
    mean = near @ inverse / divisor
    scatter2 = np.maximum(near @ inverse**2 / divisor - mean**2, 0.0)
    unknown = UNKNOWN_NEIGHBOURS / (total + UNKNOWN_NEIGHBOURS)
    mean = np.maximum((1.0 - unknown) * mean + unknown * noise.unknown_mean, new.on_floor)
    variance = scatter2 + (NEIGHBOUR_DEPTH * mean) ** 2 + unknown * noise.unknown**2
    kept = new.floor
    return replace(new, inverse_m=np.where(kept, new.inverse_m, mean), variance=np.where(kept, new.variance, variance))


def scaled_by_floor(
    landmarks: Landmarks,
    observed: Array,
    camera: FloorCamera,
    start: Viewpoint,
    noise: Noise,
    located: Located,
    enough: tuple[float, float],
    doubtful: NDArray[np.bool_] | None = None,
    rolling: tuple[SE2, Rolling] | None = None,
) -> tuple[Landmarks, Located]:
    """Restores the scale from the floor's landmarks where they agree with each other and not with the view: the other
    landmarks then have a wrong scale (before a wall they may even agree on no motion at all). Their depth becomes
    unknown, and the view is solved again. enough: share and number of the floor's landmarks that agree. Other
    parameters are as of `locate`.
    """
    floor, (share, number) = landmarks.floor, enough
    least = max(share * float(floor.sum()), number)
    if floor.sum() < number or float(located.weights[floor].sum()) > least:
        return landmarks, located
    doubts = None if doubtful is None else doubtful[floor]
    alone = locate(landmarks.chosen(floor), observed[floor], camera, start, noise, doubts, rolling)
    if float(alone.weights.sum()) < least:
        return landmarks, located
    inverse = np.maximum(noise.unknown_mean, landmarks.on_floor)
    variance = np.maximum(noise.unknown, 0.5 * landmarks.on_floor) ** 2
    landmarks = replace(
        landmarks,
        inverse_m=np.where(floor, landmarks.inverse_m, inverse),
        variance=np.where(floor, landmarks.variance, variance),
    )
    return landmarks, locate(landmarks, observed, camera, alone.view, noise, doubtful, rolling)


def refined(
    landmarks: Landmarks, located: Located, noise: Noise, gate: float = 9.0
) -> tuple[Landmarks, NDArray[np.bool_]]:
    """The landmarks after an observation of each, and which to keep, (N,).

    A scalar Kalman update of each inverse depth. A floor landmark that fits only as a point off the floor becomes one,
    also below it, as the scale may be wrong; a landmark that fits neither is dropped.
    """
    sigma2 = noise.track_rad**2 + noise.drift_rad**2 * landmarks.age
    kept = landmarks.floor
    landmarks = replace(landmarks, inverse_m=landmarks.inverse_m * np.where(kept, 1.0, 1.0 + located.scale))
    slope2 = (located.projection.by_inverse**2).sum(axis=1)
    along = (located.projection.by_inverse * located.residual).sum(axis=1)
    total2 = (located.residual**2).sum(axis=1)
    innovation2 = sigma2 + landmarks.variance * slope2
    fit2 = (total2 - landmarks.variance * along**2 / innovation2) / sigma2
    fits = (fit2 < gate) & located.projection.ahead
    as_point = landmarks.inverse_m + along / np.maximum(slope2, 1e-12)
    across2 = total2 - along**2 / np.maximum(slope2, 1e-12)
    off_floor = ~fits & landmarks.floor & located.projection.ahead & (across2 < gate * sigma2)
    off_floor &= (as_point > 0.0) & (as_point < 10.0)
    gain = landmarks.variance / innovation2
    inverse = landmarks.inverse_m + gain * along
    variance = landmarks.variance * (1.0 - gain * slope2)
    after = Landmarks(
        landmarks.anchor_m,
        landmarks.ray,
        np.where(off_floor, as_point, inverse),
        np.where(off_floor, 4.0 * sigma2 / np.maximum(slope2, 1e-12), variance),
        landmarks.floor & ~off_floor,
        np.where(off_floor, landmarks.inverse_m, landmarks.on_floor),
        landmarks.age + 1,
    )
    return _classified(after, noise), (fits & (inverse > -0.05)) | off_floor


RISE_SHARE = 0.05  # of the rise that is attributed to the landmarks and not to the lens
KNOWN_DEPTH = 0.1  # relative standard deviation below which an inverse depth separates floor from objects
FLOOR_BAND = 0.08  # relative difference of inverse depths that still counts as floor, as the scale may be off too
BELOW_SHARE, BELOW_COUNT = 0.1, 8  # of the landmarks: as many on one plane below the floor are the floor


def _classified(landmarks: Landmarks, noise: Noise) -> Landmarks:
    """Landmarks whose depth is certain enough and on the floor become floor landmarks."""
    sigma = np.sqrt(landmarks.variance)
    off = np.abs(landmarks.inverse_m - landmarks.on_floor)
    floor = _of_known_depth(landmarks) & (off < FLOOR_BAND * landmarks.on_floor + 2.0 * sigma)
    level = np.sqrt(np.maximum(1.0 - landmarks.ray[:, 2] ** 2, 0.0)) / np.maximum(-landmarks.ray[:, 2], 1e-6)
    return replace(
        landmarks,
        inverse_m=np.where(floor, landmarks.on_floor, landmarks.inverse_m),
        variance=np.where(floor, (noise.floor_tilt_rad * level * landmarks.on_floor) ** 2, landmarks.variance),
        floor=landmarks.floor | floor,
        on_floor=np.where(floor, 0.0, landmarks.on_floor),
    )


def _of_known_depth(landmarks: Landmarks) -> NDArray[np.bool_]:
    """Which landmarks lie below the horizon, have a certain depth and are not floor yet, (N,)."""
    return (landmarks.on_floor > 0.0) & (np.sqrt(landmarks.variance) < KNOWN_DEPTH * landmarks.on_floor)


def excess_scale(landmarks: Landmarks, held: bool = True) -> float:
    """Factor by which the scale is too large, else 1: landmarks below the assumed floor show that it is a table top.

    Nothing lies below the floor, so the lowest plane on which enough landmarks agree is the floor. held: whether
    landmarks on the floor hold the scale; where none do, that plane may lie above the assumed floor as well, and the
    factor is below 1.
    """
    certain = _of_known_depth(landmarks)
    ratio = np.sort(landmarks.on_floor[certain] / np.maximum(landmarks.inverse_m[certain], 1e-6))
    ratio = ratio[(ratio > (1.0 + FLOOR_BAND if held else 1.0 / 3.0)) & (ratio < 3.0)]
    needed = max(BELOW_COUNT, int(BELOW_SHARE * len(landmarks)))
    for last in range(len(ratio) - 1, needed - 2, -1):
        agreeing = ratio[: last + 1][ratio[: last + 1] > ratio[last] * (1.0 - FLOOR_BAND)]
        if len(agreeing) >= needed:
            return float(np.median(agreeing))
    return 1.0


def rescaled(landmarks: Landmarks, camera: FloorCamera, view: Viewpoint, factor: float, noise: Noise) -> Landmarks:
    """Scales all landmarks towards a view by a factor; floor landmarks then lie above the floor, and those below it
    become floor.
    """
    lens = _lens_at(camera, view)
    anchor = landmarks.anchor_m.copy()
    anchor[:, :2] = lens[:2] + (anchor[:, :2] - lens[:2]) / factor
    return _classified(
        replace(
            landmarks,
            anchor_m=anchor,
            inverse_m=landmarks.inverse_m * factor,
            variance=landmarks.variance * factor**2,
            floor=np.zeros(len(landmarks), dtype=bool),
            on_floor=np.where(landmarks.floor, landmarks.inverse_m, landmarks.on_floor),
        ),
        noise,
    )


def reduce_tilt(
    landmarks: Landmarks, camera: FloorCamera, view: Viewpoint, share: float
) -> tuple[Landmarks, Viewpoint]:
    """Landmarks and view rotated together about the lens, and moved up or down together: a share of the view's tilt and
    rise is removed.

    Tracks observe only differences of tilt and height, so their common part drifts; by the mount both are zero on
    average. Floor landmarks are moved to where their rotated rays meet the floor.
    """
    yaw = _rotation_z(view.pose)
    part = AttitudeError(share * view.tilt.pitch_rad, share * view.tilt.roll_rad)
    removed = yaw @ part.rotation() @ yaw.T  # its transpose removes the tilt
    lens = _lens_at(camera, view)
    ray = landmarks.ray @ removed
    below = landmarks.floor | (landmarks.on_floor > 0.0)
    slope = np.where(below, np.clip(ray[:, 2] / np.where(below, landmarks.ray[:, 2], 1.0), 0.5, 2.0), 1.0)
    ratio = np.where(landmarks.floor, slope, 1.0)
    anchor = np.where(landmarks.floor[:, None], landmarks.anchor_m, lens + (landmarks.anchor_m - lens) @ removed)
    lower = RISE_SHARE * view.rise_m
    low = np.clip(anchor[:, 2] / np.maximum(anchor[:, 2] - lower, 0.1), 0.5, 2.0)
    anchor = anchor - [0.0, 0.0, lower]
    slope, ratio = np.where(below, slope * low, 1.0), np.where(landmarks.floor, ratio * low, 1.0)
    after = replace(
        landmarks, anchor_m=anchor, ray=ray, inverse_m=landmarks.inverse_m * ratio, on_floor=landmarks.on_floor * slope
    )
    left = AttitudeError(view.tilt.pitch_rad - part.pitch_rad, view.tilt.roll_rad - part.roll_rad)
    return after, Viewpoint(view.pose, left, view.rise_m - lower)


def _whitened(
    projection: Projection, residual: Array, off_floor: Array, variance: Array, sigma2: Array
) -> tuple[Array, Array]:
    """Residual (2, N) and Jacobian (2, 7, N), by view and common scale, in units of the expected residual.

    That has the covariance sigma2 I + variance g g^T, g being the residual per inverse depth.
    """
    by_inverse = projection.by_inverse.T
    slope2 = (by_inverse**2).sum(axis=0)
    along = by_inverse / np.sqrt(np.maximum(slope2, 1e-18))
    lost = 1.0 - np.sqrt(sigma2 / (sigma2 + variance * slope2))
    both = np.empty((2, 8, len(slope2)))
    both[:, 0], both[:, 1:7], both[:, 7] = residual.T, projection.by_view.transpose(1, 2, 0), by_inverse * off_floor
    both -= (lost * along)[:, None] * (along[0] * both[0] + along[1] * both[1])
    both /= np.sqrt(sigma2)
    return both[:, 0], both[:, 1:]


def _rotated_to(projection: Projection, observed: Array, start: Viewpoint, sure: NDArray[np.bool_]) -> Viewpoint:
    """The start, rotated by the median residual of its projection: yaw and pitch change fast, and are common to all."""
    across, down = medians((observed - projection.predicted)[sure])
    yaw, pitch = medians(projection.by_view[sure][:, [0, 1], [2, 3]])
    return _moved(start, np.array([0.0, 0.0, across / yaw, down / pitch, 0.0, 0.0]))


def medians(columns: NDArray[np.floating[Any]]) -> NDArray[np.floating[Any]]:
    """Median of each column (N, C), as `np.median`, but five times faster on few rows."""
    rows, middle = np.sort(columns, axis=0), len(columns) // 2
    return rows[middle] if len(rows) % 2 else (rows[middle - 1] + rows[middle]) / 2.0


def _moved(view: Viewpoint, step: Array) -> Viewpoint:
    tilt = AttitudeError(view.tilt.pitch_rad + float(step[3]), view.tilt.roll_rad + float(step[4]))
    return Viewpoint(view.pose @ SE2(*step[:3]), tilt, view.rise_m + float(step[5]))


def _lens(camera: FloorCamera, view: Viewpoint) -> Array:
    """Where the lens is in the view's base frame, (3,) m."""
    return camera.mount.position_base_m() + [0.0, 0.0, view.rise_m]


def _lens_at(camera: FloorCamera, view: Viewpoint) -> Array:
    """Where the lens is in the landmarks' frame, (3,) m."""
    return _rotation_z(view.pose) @ _lens(camera, view) + [view.pose.x_m, view.pose.y_m, 0.0]


def _rotation_z(pose: SE2) -> Array:
    rotation = np.eye(3)
    rotation[:2, :2] = pose.rotation()
    return rotation
