"""A window of keyframes, against points and poses that are projected by hand."""

import math
from dataclasses import replace

import numpy as np
import pytest

from edgemap.geometry.camera.inertial import small_rotation
from edgemap.geometry.camera.mount import Mount, up_optical
from edgemap.geometry.odometry.keyframe_window import ImagePoints, KeyframeWindow, WindowRule, _without, heading_slope
from edgemap.geometry.odometry.resection import LensPose
from edgemap.geometry.odometry.window_factors import FactorRows, PoseFactors

FOCAL_PX, HEIGHT_M = 250.0, 1.5
LEVEL = Mount.from_degrees(HEIGHT_M, 20.0)


def scene(rng, count=400):
    """Points (N, 3) on a floor and on two walls, and whether each lies on the floor."""
    floor = np.column_stack([rng.uniform(0.5, 9.0, count), rng.uniform(-3.0, 3.0, count), np.zeros(count)])
    wall = np.column_stack([rng.uniform(0.5, 9.0, count), rng.choice([-3.0, 3.0], count), rng.uniform(0.0, 2.5, count)])
    end = np.column_stack([np.full(count, 9.0), rng.uniform(-3.0, 3.0, count), rng.uniform(0.0, 2.5, count)])
    points = np.concatenate([floor, wall, end])
    return points, points[:, 2] == 0.0


def walk(pictures, nod_deg=3.0, pitch_deg=20.0):
    """Poses of a lens that moves ahead and nods, and the given attitude's up, which does not nod."""
    poses = []
    for index in range(pictures):
        mount = Mount.from_degrees(HEIGHT_M, pitch_deg + nod_deg * math.sin(0.5 * index), 1.0)
        turn = small_rotation(0.0, 0.0, 0.01 * index)
        poses.append(LensPose(turn @ mount.rotation_base_optical(), np.array([0.06 * index, 0.0, HEIGHT_M])))
    return poses


def followed(
    poses, rng, noise_px=0.3, wrong=0.0, gyro_rad=math.inf, rule=None, up_deg=10.0, height_m=HEIGHT_M,
    false_depths=None, edges_rad=None, walls=False, adds_up=False, hidden=range(0), again=True,
    shown=slice(None), loosened=None,
):  # fmt: skip
    """A window after these poses. noise_px: of tracks, in all pictures or in each; adds_up: to the next. wrong:
    share of the points off the floor that the mask takes for floor. height_m: as given. false_depths: share of the
    points whose measured depths are wrong; None: no depth is measured. edges_rad: standard deviation of up by edges of
    every third picture. walls: no point is on the floor. hidden: pictures in which four of five points are not seen;
    again: which the next one compares with those before. shown: the points that there are. loosened: picture before
    which the mount changes."""
    points, on_floor = (part[shown] for part in scene(rng))
    points, on_floor = (points[~on_floor], on_floor[~on_floor]) if walls else (points, on_floor)
    floor = np.where(on_floor | (rng.uniform(size=len(points)) < wrong), 0.9, 0.1)
    rule, up = rule or WindowRule(), up_optical(LEVEL.pitch_rad, 0.0)
    window, noise_px = KeyframeWindow(rule, FOCAL_PX, LEVEL, 12.0), np.broadcast_to(noise_px, len(poses))
    error, seen = np.zeros((len(points), 2)), np.zeros(len(points), dtype=bool)
    for index, pose in enumerate(poses):
        local = (points - pose.position_m) @ pose.rotation
        image = local[:, :2] / np.maximum(local[:, 2:], 0.1)
        before, seen = seen, (local[:, 2] > 0.3) & (np.abs(image) < [0.64, 0.48]).all(axis=1)
        seen &= (np.arange(len(points)) % 3 == 0) & ((index not in hidden) | (np.arange(len(points)) % 5 == 0))
        error = error * (before & adds_up)[:, None] + rng.normal(0.0, noise_px[index] / FOCAL_PX, image.shape)
        image = image + error
        gyro = np.eye(3) if index == 0 else poses[index - 1].rotation.T @ pose.rotation
        start = window.poses[-1] if index else LensPose(LEVEL.rotation_base_optical(), np.array([0.0, 0.0, height_m]))
        sigmas = 0.025 * height_m, 0.012 * height_m
        factors = PoseFactors(up, math.radians(up_deg), height_m, *sigmas, gyro, gyro_rad)
        measured = np.full(len(points), np.nan)
        if false_depths is not None:  # up to 6 m
            measured = 1.0 / np.where((local[:, 2] > 0.3) & (local[:, 2] < 6.0), local[:, 2], np.nan)
            measured = measured + rng.normal(0.0, rule.depth_sigma, len(points))
            measured = np.where(rng.uniform(size=len(points)) < false_depths, 1.5 * measured, measured)
        if edges_rad and index % 3 == 1:
            window.see_up(poses[index - 1].rotation[2] + rng.normal(0.0, edges_rad, 3), edges_rad)
        if index == loosened:
            window.loosen(up)
        ids = np.flatnonzero(seen)
        if again and index and index == hidden.stop:
            lost, shown = window.lost(np.flatnonzero(before))
            window.see_again(lost, shown)
        tracks = ImagePoints(ids, image[seen], np.zeros((len(ids), 2)), floor[seen], measured[seen])
        start, weight = window.resected(start, tracks) if index else (start, 0.0)
        window.step(start, factors, tracks)
        assert index == 0 or weight > 20.0
    return window


def test_motion_pitch_and_roll_are_found_from_a_mount_that_is_two_degrees_off():
    poses = walk(30)
    window = followed(poses, np.random.default_rng(0))
    assert len(window.poses) <= WindowRule().keyframes + 1
    moved, true = window.poses[-2].inverse() @ window.poses[-1], poses[-2].inverse() @ poses[-1]
    np.testing.assert_allclose(moved.position_m, true.position_m, atol=0.004)
    np.testing.assert_allclose(window.poses[-1].rotation[2], poses[-1].rotation[2], atol=math.radians(0.5))
    off = window.poses[-1].position_m - poses[-1].position_m
    assert np.linalg.norm(off) < 0.06  # of 1.74 m


def last_motion(window):
    """Displacement between the window's last two poses, and its covariance (3, 3)."""
    by = np.zeros((3, 12))
    by[:, 3:6], by[:, 9:12] = -np.eye(3), np.eye(3)
    return window.poses[-1].position_m - window.poses[-2].position_m, by @ window.covariance @ by.T


def test_a_window_whose_mount_has_changed_keeps_its_shape():
    """All points are in view all the time, so that what most poses show of them has been marginalised."""
    rotation = LEVEL.rotation_base_optical()
    poses = [LensPose(rotation, np.array([0.1 * i, 0.35 * math.sin(0.8 * i), HEIGHT_M])) for i in range(65)]
    ahead, back = ((scene(np.random.default_rng(0))[0] - poses[i].position_m) @ rotation for i in (-1, 0))
    shown = [
        (np.abs(local[:, :2] / local[:, 2:]) < [0.5, 0.4]).all(axis=1) & (local[:, 2] > 1.0) for local in (ahead, back)
    ]
    window = followed(poses, np.random.default_rng(0), shown=shown[0] & shown[1], loosened=len(poses) - 1)
    off_m = last_motion(window)[0] - (poses[-1].position_m - poses[-2].position_m)
    assert np.linalg.norm(off_m) < 0.02


@pytest.mark.parametrize(("noise_px", "off_m"), [(0.1, 0.002), (0.5, 0.006)])
def test_a_motion_is_as_uncertain_as_its_tracks_show(noise_px, off_m):
    """They are followed from picture to picture, so that their errors add up."""
    poses, errors, squares = walk(24), [], []
    for seed in range(6):
        moved, covariance = last_motion(followed(poses, np.random.default_rng(seed), noise_px, adds_up=True))
        error = moved - (poses[-1].position_m - poses[-2].position_m)
        errors.append(np.linalg.norm(error))
        squares.append(error @ np.linalg.solve(covariance, error) / 3.0)
    assert np.mean(errors) < off_m
    assert 0.3 < np.mean(squares) < 3.0


def test_a_blurred_picture_is_less_sure_than_a_sharp_one():
    windows = (followed(walk(12), np.random.default_rng(0), [0.1] * 11 + [last_px]) for last_px in (0.1, 1.5))
    sharp, blurred = (np.trace(last_motion(window)[1]) for window in windows)
    assert blurred > 20.0 * sharp


@pytest.mark.parametrize("again", [True, False])
def test_tracks_that_are_found_again_count_as_if_no_picture_lay_between(again):
    window = followed(walk(20), np.random.default_rng(0), 0.1, hidden=range(11, 19), again=again)
    points, last = window.points, len(window.poses) - 1
    twice = points.observed[:, last] & (points.observed.sum(axis=1) > 1)
    before = last - 1 - points.observed[:, last - 1 :: -1].argmax(axis=1)
    spans = (points.number[:, last] - points.number[np.arange(len(points)), before])[twice]
    assert spans.min() == 1
    assert (spans == 1).mean() > 0.9 if again else (spans > 7).mean() > 0.5  # new points are not known yet


def test_edges_of_the_room_show_the_tilt_of_a_camera_eight_degrees_off_its_mount():
    poses = walk(30, pitch_deg=28.0)
    for edges_rad, low_deg, high_deg in ((math.radians(0.7), 0.0, 1.2), (None, 1.8, 10.0)):
        window = followed(poses, np.random.default_rng(2), edges_rad=edges_rad, walls=True)
        off_rad = np.linalg.norm(np.cross(window.poses[-1].rotation[2], poses[-1].rotation[2]))
        assert low_deg < math.degrees(off_rad) < high_deg
        assert off_rad < 3.0 * math.sqrt(np.trace(window.covariance[6:8, 6:8]) / 2.0)


def test_edges_are_kept_when_their_picture_leaves_and_a_wrong_direction_loses_weight():
    first, second = walk(2, nod_deg=20.0)
    up = up_optical(LEVEL.pitch_rad, 0.0)
    seen = PoseFactors(up, 0.1, HEIGHT_M, 0.01, 0.01, np.eye(3), edges=first.rotation[2], edges_rad=0.01)
    kept = PoseFactors(up, 0.1, HEIGHT_M, 0.01, 0.01, np.eye(3)).after(seen, second.rotation.T @ first.rotation)
    np.testing.assert_allclose(kept.edges, second.rotation[2], atol=1e-9)
    assert kept.edges_rad == seen.edges_rad
    window = followed(walk(10), np.random.default_rng(0))
    window.see_up(walk(10)[-1].rotation[2], 0.01)
    near_rad = window._factors[-1].edges_rad
    window.see_up(up_optical(LEVEL.pitch_rad + 0.5, 0.3), 0.01)
    assert near_rad == 0.01
    assert window._factors[-1].edges_rad > 0.05


@pytest.mark.parametrize(("false_depths", "share"), [(0.0, 0.005), (0.25, 0.01)])
def test_measured_depths_keep_the_scale_where_the_height_is_wrong(false_depths, share):
    """30 % too high: without depth the path is as much too long."""
    lengths = {}
    for given in (None, false_depths):
        window = followed(walk(30), np.random.default_rng(1), height_m=1.3 * HEIGHT_M, false_depths=given)
        lengths[given is None] = window.poses[-1].position_m[0] / (0.06 * 29)
    assert lengths[True] == pytest.approx(1.3, abs=0.05)
    assert lengths[False] == pytest.approx(1.0, abs=share)


def followed_from_the_mount(pictures, points, floor, rng, depth=False):
    """A window after a straight way from the mount's own pose, along points (N, 3) with the mask's probabilities, and
    the sum of its motions as they were known at their time."""
    travelled_m = 0.0
    window, up = KeyframeWindow(WindowRule(), FOCAL_PX, LEVEL, 12.0), up_optical(LEVEL.pitch_rad, 0.0)
    factors = PoseFactors(up, math.radians(3.0), HEIGHT_M, 0.025 * HEIGHT_M, 0.012 * HEIGHT_M, np.eye(3))
    for index in range(pictures):
        pose = LensPose(LEVEL.rotation_base_optical(), np.array([0.06 * index, 0.0, HEIGHT_M]))
        local = (points - pose.position_m) @ pose.rotation
        image = local[:, :2] / np.maximum(local[:, 2:], 0.1)
        ids = np.flatnonzero((local[:, 2] > 0.3) & (np.abs(image) < [0.64, 0.48]).all(axis=1))
        image = image[ids] + rng.normal(0.0, 0.3 / FOCAL_PX, (len(ids), 2))
        measured = 1.0 / np.where(local[ids, 2] < 6.0, local[ids, 2], np.nan)
        measured = measured + rng.normal(0.0, WindowRule().depth_sigma, len(ids))
        tracks = ImagePoints(ids, image, np.zeros_like(image), floor[ids], measured if depth else measured * np.nan)
        start = window.resected(window.poses[-1], tracks)[0] if index else pose
        window.step(start, factors, tracks)
        travelled_m += (window.poses[-1].position_m - window.poses[max(len(window.poses) - 2, 0)].position_m)[0]
    return window, travelled_m


def test_many_new_points_know_no_more_of_the_size_of_a_room_than_one():
    """Its walls are farther away than points are on average."""
    for seed in range(3):
        points, on_floor = scene(np.random.default_rng(seed), 250)
        floor = np.where(on_floor, 0.9, 0.1)
        _, travelled_m = followed_from_the_mount(10, points, floor, np.random.default_rng(seed))
        assert travelled_m == pytest.approx(0.06 * 9, rel=0.03)


def before_walls(shown):
    """Depths of points (160,) in a window after steps aside before a wall 1 m away at the left (64 points), one 4 m
    away at the right (64), whose depths are measured, and 32 other points on both, whose depths are not. shown: ids of
    each picture."""
    rng, level = np.random.default_rng(0), Mount.from_degrees(HEIGHT_M, 0.0)
    depth_m = np.repeat([1.0, 4.0, 1.0, 4.0], [64, 64, 16, 16])
    across = rng.uniform(0.1, 0.5, 160) * np.where(depth_m == 1.0, 1.0, -1.0)
    points = np.column_stack([depth_m, depth_m * across, rng.uniform(1.2, 1.8, 160)])
    window = KeyframeWindow(WindowRule(), FOCAL_PX, level, 12.0)
    factors = PoseFactors(up_optical(0.0, 0.0), 0.002, HEIGHT_M, 0.01, 0.005, np.eye(3))
    for index, ids in enumerate(shown):
        pose = LensPose(level.rotation_base_optical(), np.array([0.0, -0.01 * index, HEIGHT_M]))
        local = ((points - pose.position_m) @ pose.rotation)[ids]
        measured = np.where(ids < 128, 1.0 / local[:, 2], np.nan)
        none = np.zeros((len(ids), 2))
        tracks = ImagePoints(ids, local[:, :2] / local[:, 2:], none, none[:, 0], measured)
        window.step(pose, factors, tracks, carried=False)
    return window.local(np.arange(160), window.poses[-1])[:, 2]


def test_what_a_view_shows_need_not_be_as_near_as_what_has_left_it():
    """The near wall stays in view, or leaves it two pictures before the last."""
    near, others = np.arange(64), np.arange(128, 160)
    stays = before_walls([near] * 6 + [np.concatenate([near, others[:16]])] * 2 + [np.concatenate([near, others])])
    leaves = before_walls([near] * 6 + [others[:16]] * 2 + [others])
    assert stays[144] < 1.6
    assert leaves[144] > 2.0


def test_a_table_that_the_mask_takes_for_floor_has_a_level_of_its_own():
    for seed in range(2):
        points, on_floor = scene(np.random.default_rng(seed), 250)
        points[on_floor, 2] = 0.3
        points, floor = points[::3], np.where(on_floor, 0.9, 0.1)[::3]
        window, _ = followed_from_the_mount(30, points, floor, np.random.default_rng(seed), depth=True)
        assert window.poses[-1].position_m[2] == pytest.approx(HEIGHT_M, abs=0.08)
        assert window.poses[-1].position_m[0] == pytest.approx(0.06 * 29, rel=0.01)


def test_wheels_hold_the_pose_that_a_plain_front_of_unknown_depth_leaves_open():
    """A turn on the spot, before it is in the window; the lens is 0.28 m ahead of the axle."""
    mount = Mount.from_degrees(0.5, 10.0, forward_m=0.28)
    first, turn = LensPose(mount.rotation_base_optical(), mount.position_base_m()), small_rotation(0.0, 0.0, -0.13)
    second = LensPose(turn @ first.rotation, turn @ first.position_m)
    up = up_optical(mount.pitch_rad, 0.0)
    carried = PoseFactors(up, math.radians(0.3), 0.5, 0.002, 0.001, np.eye(3))
    aside_m = []
    for seed in range(4):
        rng, ids = np.random.default_rng(seed), np.arange(30)
        points = np.column_stack([np.full(30, 1.2), rng.uniform(-0.5, 0.3, 30), rng.uniform(0.2, 0.7, 30)])
        local = [(points - pose.position_m) @ pose.rotation for pose in (first, second)]
        noisy = (one[:, :2] / one[:, 2:] + rng.normal(0.0, 0.3 / FOCAL_PX, (30, 2)) for one in local)
        none = np.zeros((30, 2)), np.zeros(30), np.full(30, np.nan)
        before, now = (ImagePoints(ids, one, *none) for one in noisy)
        window = KeyframeWindow(WindowRule(), FOCAL_PX, mount, 12.0)
        window.step(first, carried, before)
        for factors in (carried, replace(carried, slip_m=0.0025)):
            pose, _ = window.resected(first, now, factors)
            aside_m.append(abs((window.base(first).inverse() @ window.base(pose)).y_m))
    assert np.mean(aside_m[::2]) > 0.03  # what wheels are for
    assert max(aside_m[1::2]) < 0.005


def test_a_gyro_holds_the_rotation_where_the_tracks_are_bad():
    poses, apart = walk(12), []
    for gyro_rad in (math.inf, math.radians(0.02)):
        window = followed(poses, np.random.default_rng(2), noise_px=1.5, gyro_rad=gyro_rad)
        moved, true = window.poses[-2].rotation.T @ window.poses[-1].rotation, poses[-2].rotation.T @ poses[-1].rotation
        apart.append(np.abs(moved - true).max())
    assert apart[1] < 0.3 * apart[0]


@pytest.mark.parametrize("false_depths", [None, 0.0])
def test_the_covariance_is_that_of_the_errors(false_depths):
    """Three on average where both agree; errors of the tilt last, so that single motions err by more."""
    scaled = []
    for seed in range(12):
        poses = walk(12)
        window = followed(poses, np.random.default_rng(seed), noise_px=0.9, false_depths=false_depths)
        by = np.zeros((3, 12))
        by[:, 3:6], by[:, 9:] = -np.eye(3), np.eye(3)
        covariance = 4.0 * by @ window.covariance @ by.T
        error = window.poses[-1].position_m - window.poses[-2].position_m
        error -= poses[-1].position_m - poses[-2].position_m
        scaled.append(error @ np.linalg.solve(covariance, error))
    assert 1.0 < np.mean(scaled) < 6.0


def test_an_eliminated_pose_leaves_the_solution_of_the_others():
    rng = np.random.default_rng(3)
    root = rng.normal(size=(40, 18))
    information, right = root.T @ root, rng.normal(size=18)
    solution = np.linalg.solve(information, right)
    left = _without(information, right, range(6, 12))
    np.testing.assert_allclose(np.linalg.solve(*left), np.delete(solution, range(6, 12)), rtol=1e-4)


def test_factors_are_the_derivatives_of_their_residuals():
    """By finite differences."""
    mount = Mount.from_degrees(0.5, 12.0, 1.0)
    rng, rotation, position, factors = np.random.default_rng(4), [], [], []
    for index in range(4):
        tilted = Mount.from_degrees(0.5, 12.0 + rng.normal(), 1.0 + rng.normal())
        rotation.append(small_rotation(0.0, 0.0, 0.4 * index) @ tilted.rotation_base_optical())
        position.append(np.array([0.1 * index, 0.05 * index, 0.5 + 0.01 * rng.normal()]))
        gyro = np.eye(3) if index == 0 else rotation[-2].T @ rotation[-1] @ small_rotation(*rng.normal(0, 1e-4, 3))
        up = up_optical(mount.pitch_rad, mount.roll_rad)
        factors.append(PoseFactors(up, 0.005, 0.5, 0.01, 0.005, gyro, 0.002, 0.1))
    rows, everyone = FactorRows(factors, np.array([-0.1, 0.02])), np.arange(4)

    def residuals(delta):
        turned = [small_rotation(*delta[6 * i : 6 * i + 3]) @ rotation[i] for i in range(4)]
        moved = [position[i] + delta[6 * i + 3 : 6 * i + 6] for i in range(4)]
        return rows.rows(np.array(turned), np.array(moved), everyone, everyone[1:])[1]

    by, start = rows.rows(np.array(rotation), np.array(position), everyone, everyone[1:])
    np.testing.assert_allclose(residuals(np.zeros(24)), start)
    for column in range(24):
        delta = np.zeros(24)
        delta[column] = 1e-6
        slope = (residuals(delta) - residuals(-delta)) / 2e-6
        np.testing.assert_allclose(-slope, by[:, column], atol=2e-2 * np.abs(by).max(axis=1).max())


@pytest.mark.parametrize("pitch_deg", [-30.0, 0.0, 25.0])
def test_a_tilt_of_a_lens_that_looks_down_turns_its_heading(pitch_deg):
    mount, turn = Mount.from_degrees(1.0, pitch_deg, 4.0), small_rotation(0.0, 0.0, 0.7)
    pose, window = (
        LensPose(turn @ mount.rotation_base_optical(), np.zeros(3)),
        KeyframeWindow(WindowRule(), FOCAL_PX, mount, 20.0),
    )
    by_difference = [
        (window.base(replace(pose, rotation=small_rotation(*step) @ pose.rotation)).yaw_rad - window.base(pose).yaw_rad)
        / 1e-6
        for step in 1e-6 * np.eye(3)
    ]
    np.testing.assert_allclose(heading_slope(pose), by_difference, atol=1e-5)
