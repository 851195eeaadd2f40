import inspect
import json
from typing import Any, cast

import numpy as np
import pytest
from support.rooms import content_of

import edgemap as edgemap_api
from edgemap.cli import main
from edgemap.geometry.camera.floor import FloorCamera
from edgemap.geometry.camera.mount import Mount
from edgemap.geometry.errors import EdgemapError
from edgemap.geometry.objects.annotations import Annotations, Zone
from edgemap.geometry.se2 import SE2
from edgemap.opening import GuessWarning
from edgemap.runtime.frames import extras
from edgemap.runtime.frames.errors import CameraError, CameraFault, MissingExtraError
from edgemap.runtime.inputs.drives.camera_yaml import CameraFile, read_camera_yaml, write_camera_yaml
from edgemap.runtime.motion import height_check
from edgemap.runtime.motion.height_check import HeightRule
from edgemap.runtime.outputs.sinks.run_folder import RunFolder
from edgemap.runtime.step.config import Config
from edgemap.runtime.step.map_file import load_annotated_map, save_map


@pytest.fixture
def painted_bundle(floorless_bundle):
    """Of noise a floor would move."""
    return floorless_bundle


def test_a_damaged_picture_ends_no_session_and_the_map_is_the_commands(painted_bundle, pictures, tmp_path, edgemap):
    (pictures / "5.png").write_bytes(b"no picture")
    with edgemap_api.open(camera=f"{pictures}", bundle=painted_bundle) as session:
        results = list(session)
    assert len(results) == 11
    assert [[fault.kind.value for fault in result.faults] for result in results[4:7]] == [[], ["damaged"], []]
    session.save(tmp_path / "map.json")
    done = edgemap.ok("run", "--camera", pictures, "--bundle", painted_bundle, "--out", tmp_path / "run")
    assert content_of(tmp_path) == content_of(tmp_path / "run")
    (line,) = [line for line in done.stderr.splitlines() if "5.png" in line]
    assert line.startswith("frame 5: ")
    record = json.loads((tmp_path / "run" / "run.json").read_text())
    assert f"{record['fault_count']} fault" in done.stdout
    (fault,) = [fault for fault in record["faults"] if fault["kind"] == "damaged"]
    assert "5.png: not a picture that OpenCV reads (10 bytes)" in fault["text"]


def test_strict_raises_the_first_fault(painted_bundle, pictures):
    (pictures / "5.png").write_bytes(b"no picture")
    with edgemap_api.open(camera=f"{pictures}", bundle=painted_bundle, strict=True) as session:
        assert [next(session).frame.index for _ in range(5)] == [0, 1, 2, 3, 4]
        with pytest.raises(CameraFault, match="skipped"):
            next(session)


@pytest.mark.parametrize(("mount", "height_m"), [(None, None), (0.83, 0.83), ((0.7, 3.0), 0.7)])
def test_what_a_source_does_not_bring_is_guessed_as_by_the_command(painted_bundle, pictures, tmp_path, mount, height_m):
    (pictures / "camera.yaml").unlink()
    given = () if mount is None else ("--mount", str(mount).strip("()").replace(" ", ""))
    opened, guessed = {"camera": pictures, "bundle": painted_bundle}, "guessed from 12 pictures: focal length 51"
    with pytest.warns(GuessWarning, match=guessed) as warned, edgemap_api.open(**opened, mount=mount) as session:
        list(session)
    guess = cast(GuessWarning, warned[0].message).guess
    assert (guess.height_sigma == 0.0) == (height_m is not None)
    assert session.camera.info.mount == guess.mount
    assert height_m in (None, guess.mount.height_m)
    session.save(tmp_path / "map.json")
    words = ("run", "--camera", pictures, "--bundle", painted_bundle, *given, "--out", tmp_path / "run")
    main([str(word) for word in words])
    assert content_of(tmp_path) == content_of(tmp_path / "run")
    assert session.verdict.level != "good"


def test_a_saved_map_is_loaded_as_a_session_has_it(painted_bundle, pictures, tmp_path):
    with edgemap_api.open(camera=pictures, bundle=painted_bundle) as session:
        results = list(session)
    assert results[-1].trajectory is session.slam.mapper.trajectory
    session.save(tmp_path / "map.json")
    loaded = edgemap_api.load(tmp_path / "map.json")
    (item,), (chair,) = session.map, loaded
    assert chair.id == item.id
    assert [chair.x_m, chair.y_m] == pytest.approx(item.place_m, abs=1e-6)
    of_file, of_session = loaded.annotations.identity, session.map.annotations.identity
    assert of_file
    assert of_session
    assert (of_file.map_id, of_file.reasons) == (of_session.map_id, of_session.reasons)
    assert (loaded.grid is None) == (session.map.grid is None)
    assert loaded.rooms == session.map.rooms
    drawn = [json.loads(one.to_geojson())["features"] for one in (session.map, loaded)]
    assert [one["id"] for one in drawn[0] if one["id"] != "trajectory"] == [one["id"] for one in drawn[1]]


def test_a_camera_file_brings_lens_and_mount(painted_bundle, pictures, tmp_path):
    bare = tmp_path / "bare"
    bare.mkdir()
    (bare / "0.png").write_bytes((pictures / "0.png").read_bytes())
    with edgemap_api.open(camera=f"{bare}", bundle=painted_bundle, camera_file=pictures / "camera.yaml") as session:
        assert session.camera.info.intrinsics == read_camera_yaml(pictures / "camera.yaml").intrinsics
        shown = repr(next(session))
    assert shown.startswith("<StepResult of frame 0 at 0.00 s: x 0.00 m, y 0.00 m, yaw 0.0 deg; ")
    assert len(shown) < 150
    with pytest.raises(CameraError, match=r"nowhere\.yaml: cannot be read"):
        edgemap_api.open(camera=f"{bare}", bundle=painted_bundle, camera_file=tmp_path / "nowhere.yaml")


def test_the_camera_file_of_a_guess_stays_a_guess(painted_bundle, pictures, tmp_path, monkeypatch):
    """As in a run: sizes of objects correct a height that is hardly known, and the verdict contains the guess; a mount
    that is given is none."""
    described, file = read_camera_yaml(pictures / "camera.yaml"), tmp_path / "guess.yaml"
    guess = {"method": "guessed", "focal_sigma_share": 0.0, "height_sigma_share": 0.9, "sigma_pitch_deg": 0.0}
    write_camera_yaml(file, CameraFile(described.intrinsics, described.mount, calibration=guess))
    monkeypatch.setattr(height_check, "FEWEST", 1)  # the source has three pictures
    soon = Config(height=HeightRule(judged_s=0.0))
    for name, more, guessed in (("guess", {}, True), ("given", {"mount": (1.0, 0.0)}, False)):
        folder = RunFolder(tmp_path / name, FloorCamera(described.intrinsics, Mount(1.0, 0.0)), {})
        options: dict[str, Any] = {"camera_file": file, "sinks": [folder], "config": soon} | more
        with edgemap_api.open(camera=f"{pictures}", bundle=painted_bundle, **options) as session:
            assert (list(session)[-1].observed.scale != 1.0) is guessed
        record = json.loads((tmp_path / name / "run.json").read_text())
        assert ("camera_guess" in record) is guessed
        assert any("the mount is guessed (height to" in reason for reason in record["verdict"]["reasons"]) is guessed


def test_a_webcam_is_asked_for_the_size_of_its_lens(pictures, monkeypatch):
    def opened(_, how):
        raise CameraError(f"asked for {how.intrinsics.width} px")

    monkeypatch.setattr("edgemap.opening.open_camera", opened)
    width = read_camera_yaml(pictures / "camera.yaml").intrinsics.width
    with pytest.raises(CameraError, match=f"asked for {width} px"):
        edgemap_api.open(camera=0, camera_file=pictures / "camera.yaml")


@pytest.mark.parametrize(
    ("origin", "told"),
    [
        ('{"url": "file:///my%20clone", "dir_info": {"editable": true}}', "pip install -e '/my clone[view]'"),
        ('{"url": "file:///home/u/clone", "dir_info": {}}', "pip install '/home/u/clone[view]'"),
        (None, "pip install 'edgemap-robot[view]'"),
    ],
)
def test_a_hint_works_from_where_the_installation_came(monkeypatch, origin, told):
    class Installed:
        def read_text(self, name):
            assert name == "direct_url.json"
            return origin

    monkeypatch.setattr(extras, "distribution", lambda name: Installed())
    monkeypatch.setattr(extras, "pip", lambda: "pip")
    assert extras.install_hint("view") == told
    with pytest.raises(MissingExtraError, match="the page needs no_such_module: pip install"):
        extras.need("view", "the page", ("json", "no_such_module"))


LENS, MOUNT = (50.0, 50.0, 31.5, 31.5), (1.0, 0.0)  # of the painted bundle's scene, 64x64 px
KNOWN = {"intrinsics": LENS, "mount": MOUNT}


def noise(count):
    return [np.random.default_rng(index).integers(0, 255, (64, 64, 3), dtype=np.uint8) for index in range(count)]


@pytest.mark.parametrize("stamped", [False, True])
def test_pushed_pictures_make_the_map_of_the_same_frames(painted_bundle, stamped):
    """Frames without stamps come ten times a second."""
    pictures, options = noise(12), {**KNOWN, "bundle": painted_bundle}
    stamps = [(0.2 if stamped else 0.1) * index for index in range(12)]
    given = zip(stamps, pictures, strict=True) if stamped else iter(pictures)
    with edgemap_api.open(frames=given, **options) as session:
        results = list(session)
    assert [result.frame.stamp_s for result in results] == pytest.approx(stamps)
    with edgemap_api.open(**options) as pushed:
        assert pushed.map == []
        poses = [pushed.push(*one).pose_map_base for one in zip(pictures, stamps, strict=True)]
    assert poses == [result.pose_map_base for result in results]
    places = [[(item.id, *item.position_m) for item in one.map] for one in (pushed, session)]
    assert places[0] == places[1]
    assert [item.label for item in session.map] == ["chair"]


def test_pushed_wheels_move_the_robot(painted_bundle):
    options = {**KNOWN, "bundle": painted_bundle}
    with edgemap_api.open(**options) as session:
        for index, picture in enumerate(noise(8)):
            result = session.push(picture, 0.1 * index, imu=[], wheels=(0.05 * index, 0.0, 0.0))
        assert result.pose_map_base.x_m == pytest.approx(0.35, abs=0.03)
        with pytest.raises(CameraError, match="expected seconds after"):
            session.push(noise(1)[0], 0.1, wheels=(0.0, 0.0, 0.0))


def test_only_the_classes_asked_for_are_mapped_and_a_lens_of_another_size_is_warned_of(painted_bundle):
    options = {"frames": noise(8), **KNOWN, "bundle": painted_bundle}
    with edgemap_api.open(**options, classes=["couch"]) as session:
        list(session)
    assert session.map == []
    with edgemap_api.open(**options, classes=["person"]) as session:
        list(session)
    assert [item.label for item in session.map] == ["person"]  # mapped where it is named
    with pytest.raises(EdgemapError, match="classes unicorn: the bundle knows chair, couch, person"):
        edgemap_api.open(**options, classes=["unicorn"])
    half = [picture[:32, :32] for picture in noise(1)]
    with pytest.warns(UserWarning, match="31.5,31.5 is far from the middle of 32x32 px"):
        edgemap_api.open(frames=half, intrinsics=(50.0, 50.0, 31.5, 31.5), mount=(1.0, 40.0), bundle=painted_bundle)
    assert dir(edgemap_api) == ["GuessWarning", "MapObjects", "Session", "__version__", "load", "open"]


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"frames": noise(2), "mount": MOUNT}, r"pass intrinsics=\(fx, fy, cx, cy\)"),
        ({"frames": noise(2), "intrinsics": LENS}, r"pass mount=\(height_m, pitch_deg\)"),
        ({"intrinsics": LENS}, r"pass mount=\(height_m, pitch_deg\)"),
        ({"frames": noise(2), "intrinsics": LENS, "mount": (1.0,)}, r"mount=\(1.0,\): expected a height"),
        ({"camera": "demo", "mount": np.float32(60)}, "a lens 60 m above the floor"),
        ({"frames": 5}, "frames=5: expected pictures"),
        ({"frames": noise(2), "intrinsics": (50.0, 50.0), "mount": MOUNT}, "expected four numbers"),
        ({"frames": noise(2), "intrinsics": (31.5, 31.5, 500, 500), "mount": MOUNT}, "500,500 is outside the picture"),
        ({"frames": [], **KNOWN}, "frames= has no picture"),
        ({"frames": [np.zeros((8, 8))], **KNOWN}, r"is float64 \(8, 8\), expected a BGR"),
        ({"frames": noise(2), "camera": "demo"}, "camera= or frames=, not both"),
        ({"frames": noise(2), **KNOWN, "map": "home", "clustering": "paper"}, "a saved map goes on by association"),
        ({"frames": noise(2), **KNOWN, "map": ""}, "the map's name is empty"),
        ({"camera": "demo", "clustering": "Paper"}, "clustering='Paper': expected default or paper"),
        ({**KNOWN, "confidence": 3.0}, "confidence=3: expected more than 0, at most 1"),
        ({"frames": noise(1), **KNOWN, "rate": -1.0}, "rate=-1: expected more than 0"),
        ({"frames": noise(1), **KNOWN, "rotate": 90}, "rotate=90: only the source"),
        ({"camera": "demo", "rotate": 45}, "rotate=45: expected 0, 90, 180 or 270"),
        ({"frames": noise(1), **KNOWN, "start": "dock"}, r"in a saved map \(--map, map=\)"),
    ],
)
def test_errors_name_a_parameter_that_exists(painted_bundle, options, words):
    with pytest.raises(EdgemapError, match=words) as raised:
        edgemap_api.open(bundle=painted_bundle, **options)
    named = {word.rstrip("=") for word in str(raised.value).replace("(", " ").split() if word.endswith("=")}
    assert named <= set(inspect.signature(edgemap_api.open).parameters)


@pytest.mark.parametrize("start", [(1.0, -2.0, 0.5), SE2(1.0, -2.0, 0.5), "1,-2,28.64788975654116", "dock"])
def test_a_saved_map_goes_on_at_a_stated_pose(painted_bundle, tmp_path, start):
    options = {**KNOWN, "bundle": painted_bundle}
    save_map(tmp_path / "map.json", [], Annotations(dock=SE2(1.0, -2.0, 0.5)))
    with edgemap_api.open(map=tmp_path / "map.json", start=start, **options) as session:
        pose = session.push(noise(1)[0], 0.0).pose_map_base
        assert pose.vector() == pytest.approx([1.0, -2.0, 0.5])


def test_what_is_searched_believed_and_used_of_the_source_is_stated(painted_bundle):
    pushed = {**KNOWN, "bundle": painted_bundle}
    with edgemap_api.open(rate=2.0, wheels=False, confidence=0.99, **pushed) as session:
        steps = [session.push(one, 0.1 * n, wheels=(0.05 * n, 0.0, 0.0)) for n, one in enumerate(noise(11))]
    assert [step.frame.index for step in steps if step.frame.search] == [0, 5, 10]
    assert session.map == []
    assert abs(steps[-1].pose_map_base.x_m) < 0.3  # wheels alone: 0.5


def test_a_saved_map_without_objects_keeps_its_zones(painted_bundle, tmp_path):
    """There is nothing to relocalise by, so the session continues it at once, as the command does."""
    hall = Zone("zone-1", "hall", ((0.0, 0.0), (4.0, 0.0), (4.0, 3.0)))
    save_map(tmp_path / "map.json", [], Annotations(zones=(hall,), dock=SE2(1.0, 2.0, 0.0)))
    options = {**KNOWN, "bundle": painted_bundle}
    with edgemap_api.open(map=tmp_path / "map.json", **options) as session:
        first = session.push(noise(1)[0], 0.0)
    assert (first.pose_map_base.x_m, first.pose_map_base.y_m) == (1.0, 2.0)
    session.save(tmp_path / "later.json")
    assert load_annotated_map(tmp_path / "later.json")[1].zones == (hall,)


def test_a_session_that_reads_a_camera_or_is_closed_takes_no_pictures(painted_bundle, pictures):
    with edgemap_api.open(camera=pictures, bundle=painted_bundle) as session:
        with pytest.raises(CameraError, match="open one with intrinsics= and mount= alone"):
            session.push(noise(1)[0], 0.0)
        assert next(session).frame.index == 0
    with edgemap_api.open(intrinsics=LENS, mount=MOUNT, bundle=painted_bundle) as session:
        session.push(noise(1)[0], 0.0)
    with pytest.raises(CameraError, match="this session is closed"):
        session.push(noise(2)[1], 0.1)


@pytest.mark.parametrize(("unit", "begin_s"), [(1e3, 0.0), (1e6, 1.7e9), (1e9, 0.0)])
def test_stamps_that_cannot_be_seconds_are_refused(unit, begin_s, painted_bundle):
    options = {**KNOWN, "bundle": painted_bundle}
    wanted = pytest.raises(CameraError, match="stamps are seconds, not milliseconds")
    with edgemap_api.open(**options) as session, wanted:
        for index, picture in enumerate(noise(5)):
            session.push(picture, (begin_s + 0.1 * index) * unit)


def test_a_pause_is_no_fault_once_pictures_have_come_in_seconds(painted_bundle):
    with edgemap_api.open(intrinsics=LENS, mount=MOUNT, bundle=painted_bundle) as session:
        for picture, stamp_s in zip(noise(6), (0.0, 0.1, 60.0, 120.0, 180.0, 240.0), strict=True):
            session.push(picture, stamp_s)
