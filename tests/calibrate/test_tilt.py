"""Pitch and roll from the edges of rooms: rendered with exact truth, the demo's own pictures, and what is refused."""

# pyright: reportOptionalMemberAccess=false, reportArgumentType=false

import math

import numpy as np
import pytest
from support.scenes import room

from edgemap.calibrate.tilt import fit_tilt
from edgemap.geometry.camera.intrinsics import Distortion, Intrinsics
from edgemap.geometry.camera.mount import Mount
from edgemap.runtime.frames.errors import CalibrationError
from edgemap.runtime.inputs.open import open_camera
from edgemap.runtime.motion.attitude.segments import Segments, find_segments

BENT = Distortion("brown_conrady", (-0.1, 0.03, 0.0005, -0.0004, 0.0))


@pytest.mark.parametrize(
    ("pitch_deg", "roll_deg", "distortion"),
    [(24.0, -4.0, Distortion()), (-3.0, 2.5, BENT)],
)
def test_rendered_rooms(pitch_deg, roll_deg, distortion):
    lens = Intrinsics(640, 480, 480.0, 482.0, 318.0, 241.0, distortion)
    mount = Mount.from_degrees(0.6, pitch_deg, roll_deg)
    pictures = [find_segments(room(lens, mount, 0.7 * i, i), lens) for i in range(4)]
    fit = fit_tilt(pictures)
    assert math.degrees(fit.pitch_rad) == pytest.approx(pitch_deg, abs=0.15)
    assert math.degrees(fit.roll_rad) == pytest.approx(roll_deg, abs=0.15)
    assert fit.share > 0.8
    assert max(fit.sigma) < math.radians(0.3)


def test_the_demo_drive():
    """Furniture, textures, video compression: the truth is in the demo's camera file."""
    with open_camera("demo") as camera:
        pictures = []
        while (frame := camera.read()) is not None:
            if frame.index % 10 == 0 and frame.index < 200:
                pictures.append(find_segments(frame.image, camera.info.intrinsics))
    fit = fit_tilt(pictures)
    assert math.degrees(fit.pitch_rad - camera.info.mount.pitch_rad) == pytest.approx(0.0, abs=0.3)
    assert math.degrees(fit.roll_rad - camera.info.mount.roll_rad) == pytest.approx(0.0, abs=0.3)


def random_segments(random, count):
    normals = random.normal(size=(count, 3))
    return Segments(normals / np.linalg.norm(normals, axis=1, keepdims=True), np.full(count, 0.2))


def test_edges_that_do_not_agree_are_refused():
    random = np.random.default_rng(4)
    with pytest.raises(CalibrationError, match=r"need|known to"):
        fit_tilt([random_segments(random, 60) for _ in range(8)])


def test_bare_pictures_are_refused():
    lens = Intrinsics(640, 480, 480.0, 482.0, 318.0, 241.0)
    grey = np.full((480, 640, 3), 128, np.uint8)
    with pytest.raises(CalibrationError, match=r"^0 pictures with straight edges, need 3"):
        fit_tilt([find_segments(grey, lens)] * 5)


def test_a_camera_that_nods_is_refused():
    """Pictures from a hand, not from a robot: no one pitch is right."""
    lens = Intrinsics(640, 480, 480.0, 482.0, 318.0, 241.0)
    pitches = [0.0, 5.0, 10.0, 15.0]
    pictures = [
        find_segments(room(lens, Mount.from_degrees(0.6, pitch), 0.7 * i, i), lens) for i, pitch in enumerate(pitches)
    ]
    with pytest.raises(CalibrationError, match=r"tilt changes by \d+\.\d deg"):
        fit_tilt(pictures)
