"""Recordings: what was stopped goes on and ends with the same bytes; what they hold fits together."""

from dataclasses import replace
from shutil import copytree

import cv2
import numpy as np
import pytest

from edgemap.geometry.camera.floor import FloorCamera
from edgemap.geometry.errors import EdgemapError
from edgemap.runtime.frames.camera import Camera
from edgemap.runtime.inputs.drives import open_drive
from edgemap.runtime.inputs.drives.truth import FloorLabel, floor_pairs, read_floor_labels, read_floor_plan
from edgemap.simulation import record as module
from edgemap.simulation import shots
from edgemap.simulation.errors import SimulationError
from edgemap.simulation.live import SimCamera
from edgemap.simulation.record import record

FRAMES = 5


@pytest.fixture(scope="module", autouse=True)
def quick_light(lit):
    """Coarse light, and once for all recordings."""
    patch = pytest.MonkeyPatch()
    patch.setattr(shots, "lit_home", lambda _: lit)
    yield
    patch.undo()


@pytest.fixture(scope="module")
def recorded(drawn, tmp_path_factory):
    folder = tmp_path_factory.mktemp("whole") / "drive"
    try:
        record(drawn, folder, depth=True)
    except EdgemapError as error:
        pytest.skip(str(error))
    return folder


def contents(folder):
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def test_a_recording_is_a_drive_with_all_of_its_truth(recorded, drawn):
    drive = open_drive(f"drive:{recorded}")
    assert len(drive.images) == len(drive.boxes) == len(drive.stamps_s) == FRAMES
    assert drive.intrinsics == drawn.camera.intrinsics
    assert drive.mount.height_m == drawn.camera.mount.height_m
    assert drive.mount.pitch_rad == pytest.approx(drawn.camera.mount.pitch_rad)
    motion = drawn.poses()[0].inverse() @ drawn.poses()[-1]
    assert drive.truth.poses[-1].vector() == pytest.approx(motion.vector(), abs=1e-6)
    assert drive.wheel is not None
    assert "CC BY" in (recorded / "README.md").read_text()
    assert len(list((recorded / "depth").iterdir())) == FRAMES


def test_a_recording_that_was_killed_goes_on_and_ends_the_same(recorded, drawn, tmp_path):
    class Killed(Exception):
        pass

    def kill(done, _total):
        if done == 2:
            raise Killed

    folder = tmp_path / "drive"
    with pytest.raises(Killed):
        record(drawn, folder, depth=True, progress=kill)
    assert not (folder / "poses.tum").exists()
    (folder / "images" / ".000002.jpg.4711").write_bytes(b"half a pict")
    counts = []
    record(drawn, folder, depth=True, progress=lambda done, _: counts.append(done))
    assert counts[0] == 2
    (folder / "images" / ".000002.jpg.4711").unlink(missing_ok=True)
    assert contents(folder) == contents(recorded)


def test_a_finished_recording_is_left_as_it_is_and_another_is_refused(recorded, drawn):
    before = contents(recorded)
    record(drawn, recorded, depth=True)
    assert contents(recorded) == before
    other = replace(drawn, seed=drawn.seed + 1)
    with pytest.raises(SimulationError, match=r"holds another rendering \(it differs in seed\)"):
        record(other, recorded, depth=True)


def test_a_folder_with_other_things_is_left_alone(drawn, tmp_path):
    (tmp_path / "thesis.txt").write_text("mine")
    with pytest.raises(SimulationError, match="not empty"):
        record(drawn, tmp_path)
    assert contents(tmp_path) == {"thesis.txt": b"mine"}


def test_the_live_camera_delivers_the_recorded_pictures(recorded, drawn):
    with SimCamera("sim:9107", drawn) as camera:
        assert isinstance(camera, Camera)
        info = camera.info
        assert (info.size, info.rate_hz, info.frame_count, info.live) == ((640, 480), 10.0, FRAMES, False)
        assert info.mount == drawn.camera.mount
        stamps, paths = [], sorted((recorded / "images").iterdir())
        while (frame := camera.read()) is not None:
            assert np.array_equal(frame.image, cv2.imread(str(paths[frame.index])))
            stamps.append(frame.stamp_s)
        assert stamps == pytest.approx([0.0, 0.1, 0.2, 0.3, 0.4])
        assert camera.read() is None
        assert len(camera.info.truth.poses) == FRAMES
        camera.close()
        assert camera.read() is None


def test_the_floor_plan_lies_beside_the_drive_and_comes_to_one_that_was_rendered_without(recorded, drawn, tmp_path):
    """The robot's poses lie on floor, outside of every wall and footprint; asked for again nothing is rendered."""
    from matplotlib.path import Path as Polygon

    plan = read_floor_plan(recorded)
    poses = open_drive(f"drive:{recorded}").truth.poses
    places = np.array([[pose.x_m, pose.y_m] for pose in poses])
    inside = [Polygon(area.corners_m).contains_points(places, radius=-1e-3) for area in (*plan.rooms, *plan.doorways)]
    assert np.any(inside, axis=0).all()
    for area in (*plan.walls, *(item for item in plan.footprints if item.low_m < 0.3)):
        assert not Polygon(area.corners_m).contains_points(places).any()
    assert {item["label"] for item in open_drive(f"drive:{recorded}").objects} <= {i.label for i in plan.footprints}
    older = copytree(recorded, tmp_path / "older")
    (older / "floor_plan.json").unlink()
    before = contents(older)
    record(drawn, older, depth=True)
    after = contents(older)
    assert after.pop("floor_plan.json") == (recorded / "floor_plan.json").read_bytes()
    assert after == before


def test_floor_labels_are_what_depth_and_mount_say(recorded, drawn, monkeypatch, lit):
    monkeypatch.setattr(module, "lit_home", lambda *_: lit)
    assert module.label_drive(drawn, recorded, 2) == 3
    before = contents(recorded)
    assert module.label_drive(drawn, recorded, 2) == 3
    assert contents(recorded) == before
    pairs = floor_pairs(recorded)
    assert [picture.stem for picture, _ in pairs] == ["000000", "000002", "000004"]
    camera = FloorCamera(drawn.camera.intrinsics, drawn.camera.mount)
    size = drawn.camera.intrinsics.width, drawn.camera.intrinsics.height
    rows, columns = np.mgrid[0 : size[1], 0 : size[0]]
    rays = camera.rays_base(np.column_stack([columns.ravel(), rows.ravel()]))[:, 2].reshape(rows.shape)
    for picture, path in pairs:
        labels = read_floor_labels(path, size)
        depth_m = cv2.imread(str(recorded / "depth" / f"{picture.stem}.png"), cv2.IMREAD_UNCHANGED) / 1000.0
        height_m = camera.mount.height_m + rays * depth_m
        near = (depth_m > 0.0) & (depth_m < 3.0)
        floor = near & (labels == FloorLabel.FLOOR)
        assert floor.sum() > 1000
        assert np.percentile(np.abs(height_m[floor]), 99) < 0.05
        assert np.percentile(height_m[near & (labels == FloorLabel.WALL)], 5) > 0.0
        assert (labels[near & (np.abs(height_m) < 0.003)] == FloorLabel.FLOOR).mean() > 0.9
