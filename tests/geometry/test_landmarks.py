import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from edgemap.geometry.camera.floor import FloorCamera
from edgemap.geometry.camera.intrinsics import Intrinsics
from edgemap.geometry.camera.mount import Mount
from edgemap.geometry.odometry.landmarks import (
    AttitudeError,
    Landmarks,
    Located,
    Noise,
    Projection,
    Viewpoint,
    excess_scale,
    locate,
    new_landmarks,
    project,
    reduce_tilt,
    refined,
    rescaled,
    rotated,
    scaled_by_floor,
    with_neighbours_depth,
)
from edgemap.geometry.odometry.rolling import Rolling
from edgemap.geometry.se2 import SE2

CAMERA = FloorCamera(Intrinsics(320, 240, 290.0, 290.0, 159.5, 119.5), Mount.from_degrees(0.5, 15.0, 0.0, 0.12, 0.05))
NOISE = Noise(track_rad=0.001, drift_rad=0.0003)
REACH_M = 4.0

motions = st.builds(SE2, st.floats(-0.15, 0.15), st.floats(-0.03, 0.03), st.floats(-0.15, 0.15))
tilts = st.builds(AttitudeError, st.floats(-0.004, 0.004), st.floats(-0.004, 0.004))


def scene(seed: int, floor: int = 80, walls: int = 40):
    """Points (N, 3) of the start's base frame that the camera sees there: on the floor, and on walls 3 to 8 m away."""
    rng = np.random.default_rng(seed)
    on_floor = CAMERA.floor_points(rng.uniform([0, 90], [320, 240], (floor, 2)))
    rays = CAMERA.rays_base(rng.uniform([0, 0], [320, 35], (walls, 2)))
    on_walls = CAMERA.mount.position_base_m() + rays * (rng.uniform(3, 8, walls) / rays[:, 0])[:, None]
    return np.concatenate([np.column_stack([on_floor, np.zeros(floor)]), on_walls])


def seen_from(points, view: Viewpoint):
    """Image points of a scene, worked out with matrices and not with the code under test."""
    base = np.column_stack([view.pose.inverse().apply(points[:, :2]), points[:, 2]])
    turned = (base - CAMERA.mount.position_base_m() - [0.0, 0.0, view.rise_m]) @ view.tilt.rotation()
    optical = turned @ CAMERA.mount.rotation_base_optical()
    return optical[:, :2] / optical[:, 2:]


def landmarks_of(points, view: Viewpoint | None = None):
    seen = seen_from(points, view or Viewpoint())
    return new_landmarks(np.column_stack([seen, np.ones(len(seen))]), CAMERA, view or Viewpoint(), NOISE, REACH_M)


@settings(max_examples=25)
@given(motions, tilts, st.integers(0, 10**6))
def test_the_view_is_found(motion, tilt, seed):
    points = scene(seed)
    known = landmarks_of(points)
    known.inverse_m[80:] = 1.0 / np.linalg.norm(points[80:] - CAMERA.mount.position_base_m(), axis=1)
    known.variance[80:] = 1e-6
    found = locate(known, seen_from(points, Viewpoint(motion, tilt)), CAMERA, Viewpoint(), NOISE)
    assert np.abs((motion.inverse() @ found.view.pose).vector()).max() < 2e-3
    assert found.view.tilt.pitch_rad == pytest.approx(tilt.pitch_rad, abs=1e-3)
    assert found.weights.min() > 0.8


def collapsed(times):
    """30 points on the floor, and 80 on walls whose depth is too small by a factor, and thought known to 1 %."""
    points = scene(1, floor=30, walls=80)
    known = landmarks_of(points)
    known.inverse_m[30:] = times / np.linalg.norm(points[30:] - CAMERA.mount.position_base_m(), axis=1)
    known.variance[30:] = (0.01 * known.inverse_m[30:]) ** 2
    return points, known


@pytest.mark.parametrize("times", [10.0, 30.0])
def test_a_floor_that_agrees_with_itself_takes_the_scale_back_from_walls_that_lost_it(times):
    points, known = collapsed(times)
    seen = seen_from(points, Viewpoint(SE2(0.08, 0.0, 0.0)))
    found = locate(known, seen, CAMERA, Viewpoint(), NOISE)
    assert abs(found.view.pose.x_m) < 0.02, "the walls are more"
    after, located = scaled_by_floor(known, seen, CAMERA, Viewpoint(), NOISE, found, (0.4, 8.0))
    assert located.view.pose.x_m == pytest.approx(0.08, abs=0.003)
    assert (after.floor == known.floor).all()
    assert (np.sqrt(after.variance[30:]) > 0.25).all(), "their depth is unknown"
    assert (after.inverse_m[30:] >= np.maximum(NOISE.unknown_mean, known.on_floor[30:])).all(), "none beyond the floor"
    np.testing.assert_array_equal(after.inverse_m[:30], known.inverse_m[:30])


def test_jacobians_are_the_slopes_of_what_is_seen():
    known = landmarks_of(scene(0))
    pose, tilt = SE2(0.1, 0.03, 0.06), AttitudeError(0.004, 0.0)
    projection, step = project(known, CAMERA, Viewpoint(pose, tilt)), 1e-6
    for column, change in enumerate([SE2(step, 0, 0), SE2(0, step, 0), SE2(0, 0, step)]):
        moved = project(known, CAMERA, Viewpoint(pose @ change, tilt)).predicted
        np.testing.assert_allclose((moved - projection.predicted) / step, projection.by_view[:, :, column], atol=1e-4)
    pitched = project(known, CAMERA, Viewpoint(pose, AttitudeError(tilt.pitch_rad + step, 0.0))).predicted
    np.testing.assert_allclose((pitched - projection.predicted) / step, projection.by_view[:, :, 3], atol=1e-4)
    level = project(known, CAMERA, Viewpoint(pose))
    rolled = project(known, CAMERA, Viewpoint(pose, AttitudeError(0.0, step))).predicted
    np.testing.assert_allclose((rolled - level.predicted) / step, level.by_view[:, :, 4], atol=1e-4)
    risen = project(known, CAMERA, Viewpoint(pose, tilt, step)).predicted
    np.testing.assert_allclose((risen - projection.predicted) / step, projection.by_view[:, :, 5], atol=1e-4)
    nearer = replace(known, inverse_m=known.inverse_m + step)
    np.testing.assert_allclose(
        (project(nearer, CAMERA, Viewpoint(pose, tilt)).predicted - projection.predicted) / step,
        projection.by_inverse,
        atol=1e-4,
    )


@given(st.integers(0, 2**32 - 1))
def test_a_point_off_the_floor_is_updated_and_gated_by_its_innovation(seed):
    """As a Kalman filter of one inverse depth has it; the noise of a track grows with its age."""
    random = np.random.default_rng(seed)
    residual, slope = random.normal(0.0, 0.004, (6, 2)), random.normal(0.0, 0.02, (6, 2))
    age, variance = random.integers(0, 60, 6), random.uniform(0.001, 0.09, 6)
    zeros = np.zeros(6)
    points = Landmarks(
        np.zeros((6, 3)), np.tile([1.0, 0.0, 0.0], (6, 1)), np.full(6, 0.5), variance, zeros > 0, zeros, age
    )
    projection = Projection(np.zeros((6, 2)), np.zeros((6, 2, 6)), slope, zeros == 0)
    found = Located(Viewpoint(), np.eye(6), zeros + 1.0, residual, projection, 0.0)
    after, kept = refined(points, found, NOISE, gate=9.0)
    for row in range(6):
        noise = (NOISE.track_rad**2 + NOISE.drift_rad**2 * age[row]) * np.eye(2)
        innovation = noise + variance[row] * np.outer(slope[row], slope[row])
        gain = variance[row] * slope[row] @ np.linalg.inv(innovation)
        assert after.inverse_m[row] == pytest.approx(0.5 + gain @ residual[row])
        assert after.variance[row] == pytest.approx(variance[row] * (1.0 - gain @ slope[row]))
        distance2 = residual[row] @ np.linalg.solve(innovation, residual[row])
        if abs(distance2 - 9.0) > 1e-6:
            assert kept[row] == (distance2 < 9.0 and after.inverse_m[row] > -0.05)


def test_the_tilt_after_a_gyros_rotation():
    """Of a camera that yawed by 0.3 rad and nodded, between two attitudes that were estimated."""
    before, after = CAMERA, FloorCamera(CAMERA.intrinsics, Mount.from_degrees(0.5, 12.0, 2.0))
    c, s = math.cos(0.3), math.sin(0.3)
    was, now = AttitudeError(0.01, -0.02), AttitudeError(-0.03, 0.015)
    yawed = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    base_before = was.rotation() @ before.mount.rotation_base_optical()
    rotation = base_before.T @ yawed @ now.rotation() @ after.mount.rotation_base_optical()
    tilt = rotated(was, before, rotation, after)
    assert (tilt.pitch_rad, tilt.roll_rad) == pytest.approx((-0.03, 0.015))


def test_far_points_alone_tell_the_turn_but_not_the_way():
    points = scene(1)[80:]
    found = locate(landmarks_of(points), seen_from(points, Viewpoint(SE2(0, 0, 0.05))), CAMERA, Viewpoint(), NOISE)
    assert found.view.pose.yaw_rad == pytest.approx(0.05, abs=2e-3)
    assert found.covariance.shape == (6, 6)
    assert (np.linalg.eigvalsh(found.covariance) > 0.0).all()
    assert math.sqrt(found.covariance[2, 2]) < 0.02
    assert math.sqrt(found.covariance[1, 1]) > 0.03


def test_somebody_walking_by_is_not_believed():
    points, motion = scene(2), SE2(0.06, 0, 0.02)
    seen = seen_from(points, Viewpoint(motion))
    seen[:30] += [0.06, 0.01]
    found = locate(landmarks_of(points), seen, CAMERA, Viewpoint(SE2(0.05, 0, 0)), NOISE)
    assert np.abs((motion.inverse() @ found.view.pose).vector()).max() < 5e-3
    assert found.weights[:30].max() < 0.1
    _, keep = refined(landmarks_of(points), found, NOISE)
    assert keep[30:80].all()


def test_what_stands_before_the_floor_is_found_out():
    points, motion = scene(3), SE2(0.25, 0.0, 0.0)
    lens = CAMERA.mount.position_base_m()
    points[:20] = lens + 0.6 * (points[:20] - lens)  # on furniture: nearer than the floor along the same ray
    known = landmarks_of(points)
    assert known.floor[:20].all()
    found = locate(known, seen_from(points, Viewpoint(motion)), CAMERA, Viewpoint(SE2(0.24, 0, 0)), NOISE)
    after, _ = refined(known, found, NOISE)
    standing = ~after.floor[:20]
    assert standing.sum() > 10
    true = 1.0 / np.linalg.norm(points[:20] - lens, axis=1)
    np.testing.assert_allclose(after.inverse_m[:20][standing], true[standing], rtol=0.2)
    assert after.floor[20:80].all()


def test_floor_that_lies_below_what_the_scale_says_tells_that_it_is_too_large():
    """All moved by half of what they would have, had the scale been right: the floor is half as far away."""
    points = scene(5, floor=60, walls=0)
    lens = CAMERA.mount.position_base_m()
    known = landmarks_of(lens + 0.5 * (points - lens))
    farther = np.arange(60) < 12
    motion = SE2(0.25, 0.0, 0.0)
    points[~farther] = lens + 0.5 * (points[~farther] - lens)  # these were where they seemed, twelve twice as far
    found = locate(known, seen_from(points, Viewpoint(motion)), CAMERA, Viewpoint(SE2(0.24, 0, 0)), NOISE)
    after, keep = refined(known, found, NOISE)
    below = farther & keep & ~after.floor
    assert below.sum() >= 8
    np.testing.assert_allclose(after.on_floor[below], known.inverse_m[below])


def test_depths_that_err_together_do_not_move_a_robot_sideways_in_a_turn():
    """A wall that was mapped at a quarter of its distance: the lens, ahead of the axle, seems to swing by a quarter."""
    points, lens = scene(3, floor=0, walls=90), CAMERA.mount.position_base_m()
    points[:, 0] = 1.2
    inverse_m = 4.0 / np.linalg.norm(points - lens, axis=1)
    mapped = replace(landmarks_of(points), inverse_m=inverse_m, variance=np.full(90, 0.02**2))
    seen = seen_from(points, Viewpoint(SE2(0.0, 0.0, -0.3)))
    free = locate(mapped, seen, CAMERA, Viewpoint(), NOISE)
    held = locate(mapped, seen, CAMERA, Viewpoint(), NOISE, rolling=(SE2(), Rolling(0.01, 0.0, 0.0)))
    assert abs(free.view.pose.y_m) > 0.025
    assert abs(held.view.pose.y_m) < 0.006
    assert np.trace(held.covariance[:2, :2]) > np.trace(free.covariance[:2, :2])


def test_the_mount_holds_the_tilt_where_tracks_know_it_little():
    """20 tracks of 0.01 rad say 0.004 rad of pitch with a weight of 20 / 0.01^2; the mount says 0 with 1 / (0.2 deg)^2:
    so 0.71 of it is believed."""
    points, loose = scene(6, floor=0, walls=20), Noise(track_rad=0.01, drift_rad=0.0)
    known = landmarks_of(points)
    known.inverse_m[:], known.variance[:] = 1.0 / np.linalg.norm(points - CAMERA.mount.position_base_m(), axis=1), 1e-9
    seen = seen_from(points, Viewpoint(SE2(), AttitudeError(0.004, 0.0)))
    found = locate(known, seen, CAMERA, Viewpoint(), loose)
    tracks, mount = 20 / 0.01**2, 1.0 / math.radians(0.2) ** 2
    assert found.view.tilt.pitch_rad == pytest.approx(0.004 * tracks / (tracks + mount), rel=0.15)


def test_levelling_keeps_the_floor_on_the_floor_and_takes_a_share_of_the_tilt():
    view = Viewpoint(SE2(0.1, 0.0, 0.1), AttitudeError(0.01, -0.004))
    known = landmarks_of(scene(5), view)
    after, level = reduce_tilt(known, CAMERA, view, 0.25)
    assert level.pose == view.pose
    assert level.tilt.pitch_rad == pytest.approx(0.0075)
    heights = after.anchor_m[:, 2] + after.ray[:, 2] / after.inverse_m
    np.testing.assert_allclose(heights[after.floor], 0.0, atol=1e-9)
    before, now = project(known, CAMERA, view).predicted, project(after, CAMERA, level).predicted
    np.testing.assert_allclose(now, before, atol=2e-4)


def walked(points, known, steps=6, stride_m=0.05):
    """The landmarks after views that are known exactly, straight ahead."""
    exact = Noise(track_rad=2e-4, drift_rad=0.0)
    for step in range(1, steps + 1):
        view = Viewpoint(SE2(stride_m * step, 0.0, 0.0))
        seen = seen_from(points, view)
        projection = project(known, CAMERA, view)
        found = Located(view, np.eye(5), np.ones(len(seen)), seen - projection.predicted, projection, 0.0)
        known, keep = refined(known, found, exact)
        points, known = points[keep], known.chosen(keep)
    return known


def on_plane(pixels, height_m):
    """Where rays through pixels meet a plane above the floor, (N, 3)."""
    lens = CAMERA.mount.position_base_m()
    rays = CAMERA.rays_base(pixels)
    return lens + rays * ((height_m - lens[2]) / rays[:, 2])[:, None]


def test_a_table_seen_below_the_horizon_does_not_become_floor():
    """Floor on the left, a table top 0.15 m high on the right, neither trusted before its depth is known."""
    rng = np.random.default_rng(3)
    points = np.concatenate(
        [
            on_plane(rng.uniform([0, 130], [150, 230], (30, 2)), 0.0),
            on_plane(rng.uniform([170, 130], [320, 230], (30, 2)), 0.15),
        ]
    )
    seen = seen_from(points, Viewpoint())
    known = new_landmarks(np.column_stack([seen, np.ones(60)]), CAMERA, Viewpoint(), NOISE, REACH_M, trusting=False)
    assert not known.floor.any()
    after = walked(points, known)
    assert after.floor.sum() == pytest.approx(30, abs=3)
    assert (after.ray[after.floor, 1] > 0).all(), "the left side is the floor"
    assert excess_scale(after) == 1.0


def test_what_was_taken_for_floor_is_a_table_where_others_lie_below():
    """All depths twice too large: what is taken for floor is a table at half the lens' height, the floor seems 0.5 m
    below. Put right, the floor is the floor and the table stands on it."""
    rng = np.random.default_rng(4)
    pixels = rng.uniform([0, 130], [320, 230], (40, 2))
    known = new_landmarks(CAMERA.intrinsics.rays(pixels), CAMERA, Viewpoint(), NOISE, REACH_M)
    table = np.arange(40) < 25
    on_floor = known.inverse_m
    known = replace(
        known,
        inverse_m=np.where(table, on_floor, on_floor / 2.0),
        variance=np.full(40, 1e-6),
        floor=table,
        on_floor=np.where(table, 0.0, on_floor),
    )
    factor = excess_scale(known)
    assert factor == pytest.approx(2.0)
    after = rescaled(known, CAMERA, Viewpoint(SE2(0.3, 0.0, 0.0)), factor, NOISE)
    np.testing.assert_array_equal(after.floor, ~table)
    np.testing.assert_allclose(after.inverse_m[table], 2.0 * on_floor[table])
    assert excess_scale(after) == 1.0
    lens = CAMERA.mount.position_base_m() + [0.3, 0.0, 0.0]
    before, now = (one.anchor_m + one.ray / one.inverse_m[:, None] for one in (known, after))
    np.testing.assert_allclose((now - lens)[table, :2], (before - lens)[table, :2] / 2.0)  # half as far from the lens


def test_where_nothing_holds_the_scale_the_lowest_plane_is_the_floor():
    """All depths half of the true ones: the floor seems to lie at half the lens' height, and a table higher still."""
    rng = np.random.default_rng(4)
    pixels = rng.uniform([0, 130], [320, 230], (40, 2))
    known = new_landmarks(CAMERA.intrinsics.rays(pixels), CAMERA, Viewpoint(), NOISE, REACH_M, trusting=False)
    floor = np.arange(40) < 25
    inverse = np.where(floor, 2.0, 2.6) * known.on_floor
    collapsed = replace(known, inverse_m=inverse, variance=np.full(40, 1e-6))
    assert excess_scale(collapsed) == 1.0, "a table hides no floor"
    factor = excess_scale(collapsed, held=False)
    assert factor == pytest.approx(0.5)
    after = rescaled(collapsed, CAMERA, Viewpoint(), factor, NOISE)
    np.testing.assert_array_equal(after.floor, floor)


def test_the_rise_of_a_carried_lens_is_found_where_it_may_be():
    """Three centimetres up and a step ahead; held to the mount's height it is taken for another step."""
    points, motion = scene(3), SE2(0.1, 0.0, 0.02)
    known = landmarks_of(points)
    known.inverse_m[80:] = 1.0 / np.linalg.norm(points[80:] - CAMERA.mount.position_base_m(), axis=1)
    known.variance[80:] = 1e-6
    seen = seen_from(points, Viewpoint(motion, AttitudeError(0.01, 0.0), 0.03))
    carried = locate(known, seen, CAMERA, Viewpoint(), replace(NOISE, rise_m=0.05, tilt_rad=0.05))
    assert carried.view.rise_m == pytest.approx(0.03, abs=1e-3)
    assert np.abs((motion.inverse() @ carried.view.pose).vector()).max() < 2e-3
    level = locate(known, seen, CAMERA, Viewpoint(), NOISE)
    assert level.view.rise_m == pytest.approx(0.0, abs=1e-3)
    assert abs((motion.inverse() @ level.view.pose).x_m) > 0.01


def test_a_new_landmark_has_the_depth_of_those_beside_it_but_lies_not_beyond_the_floor():
    rays = np.array([[0.0, -0.6, 1.0], [0.0, -0.5, 1.0], [0.0, 0.6, 1.0]])
    ones = new_landmarks(rays, CAMERA, Viewpoint(), NOISE, REACH_M, trusting=False)
    old = replace(ones, inverse_m=np.full(3, 0.5), variance=np.full(3, 1e-4))
    near = np.array([[20.0, 20.0, 0.0], [0.0, 0.0, 0.0], [20.0, 20.0, 0.0]])
    found = with_neighbours_depth(ones, near, old, CAMERA, Viewpoint(), NOISE)
    assert found.inverse_m[0] == pytest.approx(0.5, abs=0.01)
    assert found.inverse_m[1] == pytest.approx(NOISE.unknown_mean)
    assert found.inverse_m[2] == pytest.approx(ones.on_floor[2])
    assert ones.on_floor[2] > 0.5
    assert found.variance[0] < found.variance[1]
