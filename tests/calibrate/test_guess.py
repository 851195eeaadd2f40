"""Lens, mount and tilt: guessed from furniture, made pictures and the demo, and measured by edges of rooms."""

import math

import numpy as np
import pytest
from support.scenes import room

from edgemap.calibrate.board import frames_of
from edgemap.calibrate.guess import guess_camera, quarter_turns
from edgemap.calibrate.stated_focal import stated_focal_px
from edgemap.calibrate.tilt import fit_tilt
from edgemap.geometry.camera.floor import FloorCamera
from edgemap.geometry.camera.intrinsics import Distortion, Intrinsics
from edgemap.geometry.camera.mount import Mount
from edgemap.geometry.observations.class_extents import HEIGHT_M, MEASURED
from edgemap.geometry.observations.detections import Detections
from edgemap.runtime.frames.errors import CalibrationError
from edgemap.runtime.inputs.drives.pictures import read_picture
from edgemap.runtime.inputs.open import open_camera
from edgemap.runtime.motion.attitude.segments import Segments, find_segments
from edgemap.runtime.network.bundle import load_bundle
from edgemap.runtime.network.decode import Decoder, Detector
from edgemap.runtime.network.store import bundle_folder

LENS = Intrinsics(640, 480, 500.0, 500.0, 319.5, 239.5)
NAMES = ("chair", "couch", "oven")
GREY = np.full((480, 640, 3), 128, np.uint8)  # without edges


def boxes_of(mount, places):
    """Boxes of upright boards of usual height and width that stand at these places of the floor."""
    camera, corners, kinds = FloorCamera(LENS, mount), [], []
    rotation, lens_m = mount.rotation_base_optical(), mount.position_base_m()
    for kind, x, y in places:
        half, high = MEASURED[NAMES[kind]][2] / 2.0, HEIGHT_M[NAMES[kind]][0]
        at = np.array([[x, y + side * half, z] for side in (-1, 1) for z in (0.0, high)]) - lens_m
        px = camera.intrinsics.project(at @ rotation)
        corners.append([px[:, 0].min(), px[:, 1].min(), px[:, 0].max(), px[:, 1].max()])
        kinds.append(kind)
    inside = [a > 0 and b > 0 and c < 640 and d < 480 for a, b, c, d in corners]
    rows = np.flatnonzero(inside)
    return Detections(np.array(corners)[rows], np.full(len(rows), 0.9), np.array(kinds)[rows], NAMES)


@pytest.mark.parametrize(("height_m", "pitch_deg", "share"), [(1.1, 20.0, 0.15), (0.4, 6.0, 0.4), (0.4, 6.0, 0.0)])
def test_furniture_of_usual_size_shows_height_and_pitch(height_m, pitch_deg, share):
    """A low lens that looks far hardly tells its pitch from its height. share: of the height's error, 0 where it is
    given."""
    random, mount = np.random.default_rng(3), Mount.from_degrees(height_m, pitch_deg)
    pieces = ((int(random.integers(3)), random.uniform(1.5, 5.0), random.uniform(-1.5, 1.5)) for _ in range(120))
    scenes = [boxes_of(mount, [piece]) for piece in pieces]
    scenes = [scene for scene in scenes if len(scene.boxes)][:40]
    rest = iter(scenes)
    given_m = None if share else height_m
    guess = guess_camera([GREY] * len(scenes), lambda _: next(rest), LENS, height_m=given_m)
    assert guess.lens is LENS
    assert (guess.height_sigma == 0.0) == ("as given" in guess.lines()[1]) == (share == 0.0)
    assert guess.mount.height_m == pytest.approx(height_m, rel=share)
    assert math.degrees(guess.mount.pitch_rad) == pytest.approx(pitch_deg, abs=3.0)
    assert guess.record()["height_sigma_share"] == guess.height_sigma  # as a replay weighs it


def test_a_camera_on_a_head_is_reported_as_carried_with_a_height_that_covers_the_truth(shared_data):
    """The lens is 1.64 m above the floor and looks down by 22 degrees on average."""
    paths = sorted((shared_data / "hololens" / "image").glob("*"))
    bundle = load_bundle(bundle_folder("edgemap-pico"))
    detector = Detector(bundle, Decoder(bundle.manifest.detector, bundle.manifest.confidence, one_name=True))
    guess = guess_camera([read_picture(path) for path in paths[:: -(-len(paths) // 16)]], detector)
    assert guess.sway_rad > math.radians(3.0)
    assert abs(math.log(guess.mount.height_m / 1.64)) < 2.5 * guess.height_sigma < 0.7
    assert abs(math.degrees(guess.mount.pitch_rad) - 22.0) < 2.5 * math.degrees(guess.pitch_sigma_rad)
    assert "it is carried" in guess.lines()[3]


def test_what_is_known_stays():
    nothing = Detections(np.zeros((0, 4)), np.zeros(0), np.zeros(0, int), NAMES)
    mount = Mount.from_degrees(0.6, 12.0)
    guess = guess_camera([GREY], lambda _: nothing, None, mount)
    assert guess.mount is mount
    assert guess.lens.fx == pytest.approx(0.8 * 640)  # the usual field of view
    assert guess.focal_sigma > 0.2
    stated = guess_camera([GREY], lambda _: nothing, None, mount, (555.0, "EXIF"))
    assert (stated.lens.fx, stated.focal_sigma) == (555.0, 0.05)
    assert "EXIF" in stated.lines()[0]


def test_a_mount_that_cannot_be_is_refused_with_its_number():
    """Chairs as small as toys, 2.5 m below the lens: it would hang 10 m up."""
    random, mount = np.random.default_rng(3), Mount.from_degrees(1.5, 30.0)
    scene = boxes_of(mount, [(0, x, y) for x, y in random.uniform((1.8, -1.0), (3.5, 1.0), (6, 2))])
    middle = scene.boxes.reshape(-1, 2, 2).mean(axis=1, keepdims=True)
    shrunk = ((scene.boxes.reshape(-1, 2, 2) - middle) * 0.15 + middle).reshape(-1, 4)
    small = Detections(shrunk, scene.scores, scene.class_ids, NAMES)
    with pytest.raises(CalibrationError, match=r"put the lens \d+\.\d\d m above the floor, expected 0.05 to 3 m"):
        guess_camera([GREY] * 10, lambda _: small, LENS)


def test_no_picture_is_no_guess():
    with pytest.raises(CalibrationError, match="no picture"):
        guess_camera([], lambda _: boxes_of(Mount(1.0), []))


def test_the_demo_is_guessed_within_its_own_sigmas():
    """Rendered pictures and the real network: focal length, height and pitch of the demo's camera."""
    with open_camera("demo") as source:
        lens, mount = source.info.intrinsics, source.info.mount
        pictures = [frame.image for frame in frames_of(source, 200) if frame.index % 12 == 0]
    bundle = load_bundle(bundle_folder("edgemap-nano"))
    guess = guess_camera(pictures, Detector(bundle, Decoder(bundle.manifest.detector, 0.3, one_name=True)))
    assert abs(math.log(guess.lens.fx / lens.fx)) < 2.0 * guess.focal_sigma < 0.1
    assert guess.mount.height_m == pytest.approx(mount.height_m, rel=0.25)
    assert abs(guess.mount.pitch_rad - mount.pitch_rad) < 2.5 * guess.pitch_sigma_rad < 0.04


def test_a_phones_picture_states_its_focal_length(tmp_path):
    """26 mm on 35 mm film: 26 / 43.27 of the diagonal."""
    image = pytest.importorskip("PIL.Image")
    exif = image.Exif()
    exif.get_ifd(0x8769)[0xA405] = 26
    image.new("RGB", (640, 480)).save(tmp_path / "a.jpg", exif=exif)
    found = stated_focal_px(tmp_path, 640, 480)
    assert found == (pytest.approx(26.0 / math.hypot(36.0, 24.0) * 800.0), "EXIF")
    image.new("RGB", (640, 480)).save(tmp_path / "a.jpg")
    assert stated_focal_px(tmp_path / "a.jpg", 640, 480) is None
    (tmp_path / "b.jpg").write_bytes(b"no picture")
    assert stated_focal_px(tmp_path / "b.jpg", 640, 480) is None


def bright_top(picture):
    """A detector that recognises a picture with a bright top for sure, and others hardly."""
    score = 0.9 if picture[: len(picture) // 4].mean() > 200 else 0.2
    return Detections(np.zeros((1, 4)), np.array([score]), np.array([0]), ("chair",))


@pytest.mark.parametrize("turns", range(4))
def test_the_turn_that_makes_pictures_upright_is_found(turns):
    upright = np.zeros((40, 60, 3), dtype=np.uint8)
    upright[:15] = 255
    assert quarter_turns([np.rot90(upright, -turns)] * 25, bright_top) == turns


def test_where_none_is_clearly_better_pictures_stay():
    assert quarter_turns([np.zeros((40, 60, 3), dtype=np.uint8)] * 3, bright_top) == 0
    assert quarter_turns([], bright_top) == 0


BENT = Distortion("brown_conrady", (-0.1, 0.03, 0.0005, -0.0004, 0.0))


@pytest.mark.parametrize(("pitch_deg", "roll_deg", "distortion"), [(24.0, -4.0, Distortion()), (-3.0, 2.5, BENT)])
def test_rendered_rooms(pitch_deg, roll_deg, distortion):
    lens = Intrinsics(640, 480, 480.0, 482.0, 318.0, 241.0, distortion)
    mount = Mount.from_degrees(0.6, pitch_deg, roll_deg)
    pictures = [find_segments(room(lens, mount, 0.7 * i, i), lens) for i in range(6)]
    fit = fit_tilt(pictures)
    assert math.degrees(fit.pitch_rad) == pytest.approx(pitch_deg, abs=0.15)
    assert math.degrees(fit.roll_rad) == pytest.approx(roll_deg, abs=0.15)
    assert fit.share > 0.8
    assert max(fit.sigma) < math.radians(0.3)


def test_edges_that_do_not_agree_and_bare_pictures_are_refused():
    normals = np.random.default_rng(4).normal(size=(8, 60, 3))
    normals /= np.linalg.norm(normals, axis=2, keepdims=True)
    with pytest.raises(CalibrationError, match=r"need|known to"):
        fit_tilt([Segments(own, np.full(60, 0.2)) for own in normals])
    with pytest.raises(CalibrationError, match=r"^0 pictures with straight edges, need 4"):
        fit_tilt([find_segments(GREY, LENS)] * 5)


def test_a_camera_that_nods_is_refused():
    """Pictures from a hand, not from a robot: no one pitch is right."""
    lens = Intrinsics(640, 480, 480.0, 482.0, 318.0, 241.0)
    mounts = [Mount.from_degrees(0.6, 4.0 * i) for i in range(6)]
    pictures = [find_segments(room(lens, mount, 0.7 * i, i), lens) for i, mount in enumerate(mounts)]
    with pytest.raises(CalibrationError, match=r"tilt changes by \d+\.\d deg"):
        fit_tilt(pictures)
