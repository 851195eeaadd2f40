"""What is wrong with a picture is told, and nothing is wrong with good ones."""

import os
from pathlib import Path

import cv2
import numpy as np
import pytest
from support.faults import kinds as kinds_of

from edgemap.runtime.frames.faults import FaultKind
from edgemap.runtime.frames.frame import Frame
from edgemap.runtime.inputs.open import open_camera
from edgemap.runtime.motion.health import HealthMonitor

SHARED = Path(os.environ.get("EDGEMAP_SHARED", Path(__file__).parents[3] / "shared")) / "data"


@pytest.fixture(scope="module")
def pictures():
    """The demo's first two seconds."""
    with open_camera("demo") as camera:
        return [frame.image for _ in range(20) if (frame := camera.read()) is not None]


@pytest.fixture(scope="module")
def drive():
    """5 s of the demo with turns."""
    with open_camera("demo") as camera:
        return [frame.image for _ in range(140) if (frame := camera.read()) is not None and frame.index >= 90]


def noisy(image, sigma, seed=0):
    return np.clip(image + np.random.default_rng(seed).normal(0.0, sigma, image.shape), 0, 255).astype(np.uint8)


def kinds(images, rate_hz=10.0):
    monitor = HealthMonitor()
    judged = [monitor.judge(Frame(i, i / rate_hz, np.ascontiguousarray(image))) for i, image in enumerate(images)]
    return [health.blindness.kind.value if health.blindness else "" for health in judged]


@pytest.mark.parametrize("part", [np.s_[:, :320], np.s_[:, 320:], np.s_[:240], np.s_[240:], np.s_[:0]])
def test_half_a_picture_that_stays_plain_while_the_rest_moves_is_a_fault(drive, part):
    monitor, told = HealthMonitor(), []
    for index, image in enumerate(drive):
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
def test_photographs_are_trusted(folder):
    if not (SHARED / folder).is_dir():
        pytest.skip(f"{SHARED / folder} is not there: set EDGEMAP_SHARED")
    paths = [path for path in sorted((SHARED / folder).rglob("*")) if path.suffix in (".jpg", ".png")][::10]
    assert set(kinds(cv2.imread(str(path)) for path in paths)) == {""}
