"""`run --map`: one map over several starts, runs that go on with a saved one, and the place among named maps."""

import json
import os
import re
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from support.drives import drive, exact, round_trip
from support.refusal import one_line
from support.rooms import content_of, furnished, mapped
from support.steps import Steps

from edgemap.cli.named_maps import find_place
from edgemap.cli.run_record import scale_source
from edgemap.geometry.errors import MapError
from edgemap.geometry.objects.annotations import Annotations, Level, MapIdentity, Zone
from edgemap.geometry.objects.events import Edit
from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.errors import RunFolderError
from edgemap.runtime.outputs.sinks.living_map import LivingMap
from edgemap.runtime.outputs.verdict.causes import CAUSES
from edgemap.runtime.outputs.verdict.verdict import Finding, Verdict
from edgemap.runtime.step.map_file import load_annotated_map, load_map, save_map
from edgemap.runtime.step.map_store import find_map, saved_map
from edgemap.runtime.step.mapper import Mapper


@pytest.fixture
def boot(edgemap, tmp_path, painted_bundle, pictures):
    """boot(NAME, *arguments) -> one start of the service, as systemd makes it: the user's data folder, a new run."""
    data = tmp_path / "data"

    def start(name, *arguments):
        out = tmp_path / "runs" / str(len(list(tmp_path.glob("runs/*"))))
        flags = ("--camera", pictures, "--bundle", painted_bundle, "--map", name, "--out", out)
        environment = {**os.environ, "XDG_DATA_HOME": str(data)}
        environment.pop("EDGEMAP_DATA", None)
        return edgemap("run", *flags, *arguments, env=environment), data / "edgemap" / "maps" / name, out

    return start


def test_two_boots_keep_one_map(boot):
    """The map of the first may be scaled by a measured height: it is of its own camera alone."""
    first, home, alone = boot("home")
    assert first.returncode == 0, first.stderr
    assert f"new map: {home}/" in first.stdout
    (chair,), _ = load_annotated_map(home)
    assert load_annotated_map(home)[1].last_pose == SE2()
    second, _, out = boot("home", "--start", "last")
    assert second.returncode == 0, second.stderr
    (again,), _ = load_annotated_map(home)
    assert (again.id, again.count) == (chair.id, 2 * chair.count)  # the very same chair, seen in both runs
    last_pose = json.loads((home / "map.json").read_text())["last_pose"]
    assert content_of(home) == content_of(out) | {"last_pose": last_pose}
    sources = [scale_source(json.loads((run / "run.json").read_text())) for run in (alone, out)]
    assert sources == ["", "a saved map, and the runs before it,"]


def test_a_boot_that_does_not_find_its_place_leaves_the_map_alone(boot, tmp_path):
    home = tmp_path / "data" / "edgemap" / "maps" / "home"
    home.mkdir(parents=True)
    save_map(home / "map.json", mapped([("couch", 1.0, 0.0), ("bed", 0.0, 4.0)]))
    before = (home / "map.json").read_bytes()
    done, _, out = boot("home")
    assert done.returncode == 0, done.stderr
    assert "not found in home" in done.stdout
    assert (home / "map.json").read_bytes() == before
    assert [item.label for item in load_annotated_map(out)[0]] == ["chair"]


def test_the_dock_is_a_start(boot, tmp_path):
    home = tmp_path / "data" / "edgemap" / "maps" / "home"
    home.mkdir(parents=True)
    assert "is a new map, whose first pose is its origin" in one_line(boot("home", "--start", "0,0,0")[0], 2)
    done, _, _ = boot("home", "--start", "dock")  # the first boot of a service begins the map
    assert done.returncode == 0, done.stderr
    assert "expected dock, last or X,Y,YAW_DEG" in one_line(boot("home", "--start", "2 m")[0], 2)
    unreliable = MapIdentity("home", level="unreliable")
    docked = Annotations(dock=SE2(2.0, 0.0, 0.0), identity=unreliable)
    save_map(home / "map.json", mapped([("chair", 7.2, 0.0)]), docked)
    done, _, _ = boot("home", "--start", "dock")
    assert done.returncode == 0, done.stderr
    (chair,), annotations = load_annotated_map(home)
    assert chair.id == "chair-1"  # 2 m + 5 m + half a chair: the saved one
    assert load_annotated_map(home)[1].last_pose == annotations.dock == SE2(2.0, 0.0, 0.0)


@pytest.mark.parametrize("before", ["good", "care", None, "unreliable"])
def test_an_unreliable_run_saves_beside_a_better_map(tmp_path, before):
    """Also where it was reliable at first; and it takes the map's place again where it becomes so."""
    identity = MapIdentity("home", 3, level=before)
    save_map(tmp_path / "map.json", mapped([("bed", 1.0, 0.0)]), Annotations(identity=identity))
    text, verdicts, steps = (tmp_path / "map.json").read_text(), list[Level](["care"]), Steps(boxes=())
    sink = LivingMap(tmp_path, bool, lambda: Verdict(verdicts[-1]))
    steps.into(sink, 12)
    labels = lambda name: [item.label for item in load_annotated_map(tmp_path / name)[0]]  # noqa: E731
    assert labels("map.json") == ["chair", "couch"]
    assert labels("map.before.json") == ["bed"]
    (tmp_path / "b").mkdir()
    (tmp_path / "b" / "map.json").write_text(text[:-9])
    (tmp_path / "b" / "map.before.json").write_text(text)
    with pytest.raises(MapError, match=r"truncated.*map\.before\.json is that of the run before"):
        load_annotated_map(tmp_path / "b")
    verdicts.append("unreliable")
    steps.into(sink, 12)
    if before == "unreliable":
        assert labels("map.json") == ["chair", "couch"]
    else:
        assert (tmp_path / "map.json").read_text() == text
        assert labels("map.unreliable.json") == ["chair", "couch"]
        assert json.loads((tmp_path / "map.unreliable.json").read_text())["grid"] == "map.unreliable.grid.npz"
        assert "stays as it was" in sink.beside
    verdicts.append("good")
    sink.close()
    sink.release()
    assert (labels("map.json"), sink.beside) == (["chair", "couch"], "")
    assert not (tmp_path / "map.unreliable.json").exists()
    save_map(tmp_path / "map.json", mapped([("bed", 1.0, 0.0)]), Annotations(identity=identity))
    findings: list[Finding] = []
    misplaced = Finding("unreliable", CAUSES["place"], "8 objects stand twice")
    verdict = lambda: Verdict("unreliable" if findings else "good", tuple(findings))  # noqa: E731
    sink = LivingMap(tmp_path, bool, verdict, lambda: findings.append(misplaced))
    steps.into(sink, 12)
    sink.close()  # only the complete map shows it
    sink.release()
    assert labels("map.json") == ["bed"]


def test_a_run_folder_and_a_file_are_only_read(tmp_path, monkeypatch):
    monkeypatch.setenv("EDGEMAP_DATA", str(tmp_path / "data"))
    monkeypatch.chdir(tmp_path)
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / "run.json").write_text("{}")
    assert not find_map("run").lives
    assert not find_map("nowhere.json").lives
    assert find_map("home").path == tmp_path / "data" / "maps" / "home"
    assert find_map(tmp_path / "flat").path == tmp_path / "flat"
    assert find_map("home").lives
    for name in ("Küche", "living room", "二階", "K" * 63):
        assert find_map(name).path == tmp_path / "data" / "maps" / name
    for folder in ("./home", "..", ".hidden", "_x", "K" * 64):
        assert find_map(folder).path == Path(folder)
    assert find_map(tmp_path / "flat").lives


def test_a_name_that_no_map_has(tmp_path, monkeypatch):
    monkeypatch.setenv("EDGEMAP_DATA", str(tmp_path))
    monkeypatch.chdir(tmp_path)
    refusal = f"home: no run folder or map.json here, and no map of that name in {tmp_path}/maps"
    with pytest.raises(MapError, match=refusal):
        saved_map("home")
    (tmp_path / "maps" / "home").mkdir(parents=True)
    (tmp_path / "maps" / "home" / "map.json").write_text("{}")
    assert saved_map("home") == tmp_path / "maps" / "home"
    assert saved_map("elsewhere/map.json") == Path("elsewhere/map.json")


def test_one_run_at_a_time(tmp_path):
    first = LivingMap(tmp_path / "home", bool)
    with pytest.raises(RunFolderError, match="another run uses this map"):
        LivingMap(tmp_path / "home", bool)
    first.release()
    LivingMap(tmp_path / "home", bool).release()


@pytest.mark.parametrize(("misses", "stays"), [(5, False), (1000000, True)])
def test_a_chair_that_is_gone_leaves_the_map(edgemap, painted_bundle, pictures, tmp_path, misses, stays):
    # Saved 3 m ahead and seen from here before; the detector sees only the chair 5 m ahead. Ten looks from two places.
    for index in range(80):  # of noise, which shows no tilt
        noise = np.random.default_rng(index).integers(0, 255, (64, 64, 3), dtype=np.uint8)
        cv2.imwrite(str(pictures / f"{index}.png"), noise)
    places = ((index / 10, 0.1 if index // 7 % 2 else -0.1) for index in range(80))
    (tmp_path / "poses.tum").write_text("".join(f"{stamp:.1f} 0 {y} 0 0 0 0 1\n" for stamp, y in places))
    chair, other = mapped([("chair", 3.0, 0.8), ("chair", 5.25, 0.0)])
    objects = [replace(item, seen_from_m=((0.25, 0.25), (-1.75, 0.25))) for item in (chair, other)]
    save_map(tmp_path / "saved.json", objects)
    saved, out = tmp_path / "saved.json", tmp_path / "run"
    driven = "--odometry", tmp_path / "poses.tum", "--start", "0,0,0", "--config", tmp_path / "c.yaml"
    (tmp_path / "c.yaml").write_text(f"config: {{forgetting: {{misses: {misses}}}}}")
    edgemap.ok("run", "--camera", pictures, "--bundle", painted_bundle, "--out", out, "--map", saved, *driven)
    assert [item.id for item in load_map(out)] == (["chair-1", "chair-2"] if stays else ["chair-2"])


ROOMS = {name: furnished(np.random.default_rng(seed), 16, apart_m=0.8) for name, seed in (("home", 11), ("office", 12))}
ZONE = Zone("zone-1", "corner", ((0.0, 0.0), (1.0, 0.0), (1.0, 1.0)))


def go(mapper, room, start_rad=0.0):
    poses = round_trip(80, start_rad=start_rad)
    return drive(mapper, room, poses, exact(poses), 7)


@pytest.fixture
def maps(tmp_path, monkeypatch):
    """Named maps of both rooms, one with a named chair and a zone."""
    monkeypatch.setenv("EDGEMAP_DATA", str(tmp_path))
    for name, room in ROOMS.items():
        mapper = Mapper()
        *_, (result, objects) = go(mapper, room)
        mapper.edit(Edit("name", objects[0].id, name="mine"))
        identity = result.annotations.identity
        (tmp_path / "maps" / name).mkdir(parents=True)
        save_map(tmp_path / "maps" / name / "map.json", mapper.objects(), Annotations((ZONE,), identity=identity))
    return tmp_path / "maps"


def test_the_place_is_the_map_that_fits_and_is_continued_with_its_names_and_zones(maps, capsys):
    before = {one.id: one for one in load_annotated_map(maps / "office")[0]}
    (maps / "damaged").mkdir()
    (maps / "damaged" / "map.json").write_text('{"objects": ')
    mapper = Mapper()
    finder = find_place(mapper)
    assert re.fullmatch(r"--map auto: .*damaged/map.json.*: left out", capsys.readouterr().err.strip())
    sink = LivingMap(lambda: finder.saved and finder.saved.path, bool, lambda: Verdict("good"))
    for result, objects in go(mapper, ROOMS["office"], start_rad=2.0):
        sink.write(result, objects)
    sink.close()
    sink.release()
    assert finder.saved.path == maps / "office"
    now = {one.id: one for one in mapper.objects()}
    assert [now[one].name for one in before if before[one].name] == ["mine"]
    assert all(np.hypot(*(now[one].position_m - before[one].position_m)) < 0.3 for one in before)
    assert [zone.name for zone in mapper.annotations().zones] == ["corner"]
    saved, annotations = load_annotated_map(maps / "office")
    assert sum(one.count for one in saved) > sum(one.count for one in before.values())
    assert annotations.identity.generation == 2


def test_a_place_that_no_map_is_of_stays_unknown_and_no_map_changes(maps):
    texts = {path: path.read_bytes() for path in maps.glob("*/map.json")}
    mapper = Mapper()
    finder = find_place(mapper)
    sink = LivingMap(lambda: finder.saved and finder.saved.path, bool, lambda: Verdict("good"))
    for result, objects in go(mapper, furnished(np.random.default_rng(13), 16, apart_m=0.8)):
        sink.write(result, objects)
    assert (finder.saved, finder.alignment) == (None, None)
    assert {path: path.read_bytes() for path in maps.glob("*/map.json")} == texts


def test_two_maps_of_one_place_are_no_answer_and_without_a_named_map_there_is_none(maps, tmp_path, monkeypatch):
    (maps / "copy").mkdir()
    (maps / "copy" / "map.json").write_bytes((maps / "home" / "map.json").read_bytes())
    mapper = Mapper()
    finder = find_place(mapper)
    list(go(mapper, ROOMS["home"], start_rad=2.0))
    assert finder.saved is None
    assert "copy and home both fit" in finder.reason
    monkeypatch.setenv("EDGEMAP_DATA", str(tmp_path / "empty"))
    with pytest.raises(MapError, match="no named map"):
        find_place(Mapper())
