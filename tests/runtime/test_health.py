"""What is wrong with a picture is told, and nothing is wrong with good ones; a robot that stands is noticed, one that
moves is not taken for one, and nothing is counted again at rest."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from support import painted
from support.faults import kinds as kinds_of

from edgemap.geometry.camera.attitude import Attitude, GyroRotation
from edgemap.geometry.camera.floor import FloorCamera
from edgemap.geometry.camera.mount import Mount
from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.faults import FaultKind
from edgemap.runtime.frames.frame import Frame
from edgemap.runtime.frames.trajectory import Trajectory
from edgemap.runtime.inputs.open import open_camera
from edgemap.runtime.motion.health import HealthMonitor, PictureHealth
from edgemap.runtime.motion.odometry.gyro import GyroOdometry
from edgemap.runtime.motion.odometry.hybrid import HybridOdometry
from edgemap.runtime.motion.odometry.recorded import RecordedOdometry
from edgemap.runtime.motion.odometry.window import WindowOdometry
from edgemap.runtime.motion.rest import RestMonitor
from edgemap.runtime.network.bundle import load_bundle
from edgemap.runtime.step.mapper import Mapper
from edgemap.runtime.step.pipeline import Pipeline
from edgemap.runtime.step.slam import SemanticSlam


@pytest.fixture(scope="module")
def drive():
    """14 s of the demo, with turns in the last 5."""
    with open_camera("demo") as camera:
        return [frame.image for _ in range(140) if (frame := camera.read()) is not None]


@pytest.fixture(scope="module")
def pictures(drive):
    return drive[:20]


def photographs(folder):
    """Those of a folder, by name; the test skips where there are none."""
    paths = sorted(path for path in folder.rglob("*") if path.suffix in (".jpg", ".png"))
    return paths or pytest.skip(f"no pictures in {folder}")


NOISE = np.random.default_rng(0).normal(0.0, 1.0, 3 * 480 * 640 + 150_000).astype(np.float32)


def noisy(image, sigma, seed=0):
    noise = NOISE[997 * seed :][: image.size].reshape(image.shape)
    return np.clip(image + sigma * noise, 0, 255).astype(np.uint8)


def kinds(images, rate_hz=10.0):
    monitor = HealthMonitor()
    judged = [monitor.judge(Frame(i, i / rate_hz, np.ascontiguousarray(image))) for i, image in enumerate(images)]
    return [health.blindness.kind.value if health.blindness else "" for health in judged]


@pytest.mark.parametrize("part", [np.s_[:, :320], np.s_[:, 320:], np.s_[:240], np.s_[240:], np.s_[:0]])
def test_half_a_picture_that_stays_plain_while_the_rest_moves_is_a_fault(drive, part):
    monitor, told = HealthMonitor(), []
    for index, image in enumerate(drive[90:]):
        image = image.copy()
        image[part] = noisy(np.full_like(image, 70), 4.0, index)[part]
        health = monitor.judge(Frame(index, index / 10.0, image))
        assert not health.blind
        told += [health.fault] if health.fault else []
    assert kinds_of(told) == (["covered_in_part"] if image[part].size else [])
    assert 0.3 < health.covered < 0.5 if told else health.covered < 0.2


def test_good_pictures_are_trusted(pictures):
    assert kinds(pictures) == [""] * 20
    barred = [picture.copy() for picture in (pictures[0], pictures[5])]
    for picture in barred:  # a levelled or letterboxed picture has borders that never change: no torn rows
        picture[: len(picture) // 4] = 114
    assert kinds(barred) == ["", ""]


RUINED = {
    "dark": lambda image: image // 30,
    "blown": lambda image: np.clip(image.astype(int) * 6 + 150, 0, 255).astype(np.uint8),
    "covered": lambda image: noisy(np.full_like(image, 70), 4.0),
    "blurred": lambda image: cv2.GaussianBlur(image, (0, 0), 8.0),
}


@pytest.mark.parametrize("kind", RUINED)
def test_a_ruined_picture_is_named_and_forgiven_at_the_next_good_one(pictures, kind):
    assert kinds([pictures[0], RUINED[kind](pictures[1]), pictures[2]]) == ["", kind, ""]


def test_pictures_that_stand_still_or_are_torn_are_named(pictures):
    found = kinds([pictures[0]] * 13 + [pictures[1]])
    assert found == ["", *["repeated"] * 9, *["frozen"] * 3, ""]
    # A sensor's noise of one grey level is enough.
    scene = np.kron(np.random.default_rng(0).integers(0, 255, (60, 80, 3)), np.ones((8, 8, 1))).astype(np.uint8)
    assert kinds([noisy(scene, 1.0, seed) for seed in range(15)]) == [""] * 15
    top, missing = pictures[19].copy(), pictures[10].copy()
    top[:200] = pictures[0][:200]
    missing[360:] = 128
    assert kinds([pictures[0], top, pictures[5]]) == ["", "torn", ""]
    assert kinds([pictures[0], missing]) == ["", "torn"]


def test_a_blindness_is_a_fault_when_it_begins_and_every_ten_seconds(pictures):
    monitor = HealthMonitor()
    found = [monitor.judge(Frame(i, i / 10, noisy(pictures[0] // 30, 1.0, i))) for i in range(121)]
    assert [i for i, health in enumerate(found) if health.fault] == [0, 100]
    assert found[0].fault.kind is FaultKind.DARK


@pytest.mark.parametrize("folder", ["hololens/image", "lounge/image", "coco_val/images", "redkitchen", "euroc"])
def test_photographs_are_trusted(folder, shared_data):
    assert set(kinds(cv2.imread(str(path)) for path in photographs(shared_data / folder)[::10])) == {""}


def judged(images, still=None, rate_hz=10.0):
    """At which pictures the robot rests."""
    monitor = RestMonitor()
    frames = (Frame(index, index / rate_hz, image) for index, image in enumerate(images))
    return [monitor.judge(frame, PictureHealth(), still)[0] for frame in frames]


def test_a_robot_that_stands_rests_after_a_second_or_at_once_where_wheels_say_so_too(pictures):
    standing = [noisy(pictures[0], 5.0, seed) for seed in range(25)]
    assert [any(judged(standing, still)[:until]) for still, until in ((None, 10), (True, 1))] == [False, False]
    assert [all(judged(standing, still)[since:]) for still, since in ((None, 10), (True, 1))] == [True, True]
    assert not any(judged(standing, still=False))


def test_a_robot_that_drives_never_rests(drive):
    assert not any(judged(drive[:60]))


def test_a_slow_creep_is_seen(pictures):
    """0.1 px a frame: less than noise from picture to picture."""
    creep = []
    for index in range(45):
        shift = np.array([[1.0, 0.0, 0.1 * index], [0.0, 1.0, 0.0]])
        creep.append(noisy(cv2.warpAffine(pictures[0], shift, (640, 480), borderMode=cv2.BORDER_REPLICATE), 2.0, index))
    assert not any(judged(creep))


def test_a_person_who_walks_by_wakes_it_and_a_change_of_exposure_does_not(pictures):
    standing = [noisy(pictures[0], 3.0, seed) for seed in range(51)]
    brighter = [noisy(np.clip(pictures[0] * (1 + 0.002 * seed) + 0.2 * seed, 0, 255), 3.0, seed) for seed in range(30)]
    assert all(judged(brighter)[10:])
    for index in range(25, 30):
        standing[index][150:400, 60 * (index - 25) : 60 * (index - 23)] //= 2
    found = judged(standing)
    assert all(found[10:25])
    assert not any(found[25:40])
    assert found[40]


@pytest.mark.parametrize("proved", [True, False])
def test_a_gyro_that_turns_shows_a_frozen_picture_once_the_camera_has_confirmed_it(pictures, proved):
    monitor, turned = RestMonitor(), GyroRotation(np.eye(3), 0.05, 0.001, proved)
    for index in range(8):
        frame = Frame(index, index / 10, noisy(pictures[0], 3.0, index))
        _, health = monitor.judge(frame, PictureHealth(), False, None, turned)
    assert health.blind == proved  # samples may be late, and no turn of now


@pytest.mark.parametrize("folder", ["hololens/image", "lounge/image", "redkitchen", "kitti00"])
def test_real_cameras_that_move_never_rest(folder, shared_data):
    assert not any(judged(cv2.imread(str(path)) for path in photographs(shared_data / folder)[:90]))


def test_a_real_camera_that_stands_rests(shared_data):
    """EuRoC's first seconds: the camera lies still but for a few nudges."""
    pictures = photographs(shared_data / "euroc" / "image")
    assert sum(judged((cv2.imread(str(path)) for path in pictures), still=True)) > 40


def rotation(yaw_rad):
    return replace(Attitude.of_mount(Mount(1.0)), rotation=GyroRotation(np.eye(3), yaw_rad, 0.001))


def test_wheels_and_gyro_say_still_or_moving_or_nothing():
    wheels = RecordedOdometry(Trajectory(np.arange(4.0), (SE2(), SE2(), SE2(0.01), SE2(0.01))), "wheels")
    assert wheels.still(0.0, None) is None
    wheels.rest(0.0)
    assert wheels.still(1.0, None) is True
    wheels.rest(1.0)
    assert wheels.still(2.0, None) is False
    gyro = GyroOdometry()
    assert [gyro.still(1.0, attitude) for attitude in (None, rotation(0.001), rotation(0.02))] == [None, True, False]
    hybrid = HybridOdometry({"wheels": wheels, "gyro": gyro})
    assert [hybrid.still(1.0, rotation(yaw_rad)) for yaw_rad in (0.001, 0.02)] == [True, False]
    assert HybridOdometry({"gyro": gyro}).still(1.0, None) is None


def test_at_rest_no_network_runs_nothing_is_counted_and_the_first_motion_is_complete(pictures, tmp_path):
    """Planar sleeps through four seconds; the first picture after them tells the motion since the last one before."""
    bundle = load_bundle(painted.write_painted(tmp_path / "b", [("chair", 40.0, 30.0, 12.0, 24.0, 0.9)]))
    with open_camera("demo") as camera:
        floor = FloorCamera(camera.info.intrinsics, camera.info.mount)
    sleepy, awake = (SemanticSlam(Pipeline(bundle, floor, WindowOdometry(floor)), Mapper()) for _ in range(2))
    moving = [Frame(index, index / 10, picture) for index, picture in enumerate(pictures[:18])]
    for frame in moving[:17]:
        sleepy.step(frame)
        awake.step(frame)
    standing = [replace(moving[16], stamp_s=1.7 + row / 10, image=noisy(pictures[16], 3.0, row)) for row in range(40)]
    results = [sleepy.step(frame) for frame in standing]
    resting = [result for result in results if result.observed.at_rest]
    counted = sum(item.count for item in sleepy.objects())
    assert len(resting) >= 15
    assert all("backbone" not in result.stages_ms and not result.sightings for result in resting)
    assert {result.motion.motion for result in resting} == {SE2()}
    assert resting[-1].detections.labels == ["chair"]
    woken = sleepy.step(replace(moving[17], stamp_s=5.7))
    expected = awake.step(moving[17])
    assert not woken.observed.at_rest
    assert sum(item.count for item in sleepy.objects()) == counted + len(woken.sightings)
    np.testing.assert_allclose(woken.motion.motion.vector(), expected.motion.motion.vector(), atol=0.004)
