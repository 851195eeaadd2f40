"""The report as a browser shows it: the live page with the run's data, which asks for nothing."""

import json
import re

import numpy as np
import pytest
from support.axe import find_axe, serious_faults
from support.made_camera import MadeCamera, raising

from edgemap.evaluation.rows import EvaluationRow
from edgemap.geometry.camera.floor import FloorCamera
from edgemap.geometry.camera.intrinsics import Intrinsics
from edgemap.geometry.camera.mount import Mount
from edgemap.geometry.objects.events import Edit
from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.errors import CameraError
from edgemap.runtime.frames.trajectory import Trajectory
from edgemap.runtime.motion.odometry.recorded import RecordedOdometry
from edgemap.runtime.network.bundle import load_bundle
from edgemap.runtime.outputs.sinks.run_folder import RunFolder
from edgemap.runtime.step.edit_queue import Edits
from edgemap.runtime.step.loop import steps
from edgemap.runtime.step.mapper import Mapper
from edgemap.runtime.step.pipeline import Pipeline
from edgemap.runtime.step.slam import SemanticSlam
from edgemap.view.about import about_run
from edgemap.view.report import sink as sink_module
from edgemap.view.report.sink import ReportFile

FLOOR = FloorCamera(Intrinsics(64, 64, 50.0, 50.0, 31.5, 31.5), Mount(1.0))
SCENERY = np.random.default_rng(0).integers(0, 255, (64, 64, 3), dtype=np.uint8)
FOUND = EvaluationRow("found", "chair", "chair-1", (5.0, -0.9), 0.25, True, ((4, -1), (6, -1), (6, 0)))
ROWS = [FOUND, EvaluationRow("missed", "bed", None, (1.0, 2.0))]
PHONE = {"width": 390, "height": 844}


@pytest.fixture(scope="module")
def bundle(floorless_bundle):
    return load_bundle(floorless_bundle)


def drive(bundle, folder, count=30, fails_at=None, record=None, truth=True, judge=None, edits=None):
    way = Trajectory(1e9 + np.arange(count) / 10, tuple(SE2(0.002 * i, 0, 0) for i in range(count)))
    real = Trajectory(way.stamps_s, tuple(SE2(0.002 * i, 0.01 * i, 0) for i in range(count)))
    pipeline = SemanticSlam(Pipeline(bundle, FLOOR, RecordedOdometry(way, "test")), Mapper())
    fails = raising(fails_at, CameraError("memory: the cable came off"))
    camera = MadeCamera(count, lambda _: SCENERY, start_s=1e9, before=fails)
    record = {"camera": "memory", "mapped": ["chair"], **(record or {})}
    about = about_run(camera, bundle, FLOOR, "truth", folder, count) | {"camera": record["camera"]}
    report = ReportFile(folder, about, real if truth else None, judge)
    for _ in steps(camera, pipeline, [RunFolder(folder, FLOOR, record), report], edits=edits):
        pass
    return report


def data_of(folder):
    """The embedded document, as the page reads it."""
    text = (folder / "report.html").read_text()
    (data,) = re.findall(r'<script id="run-data" type="application/json">(.*?)</script>', text)
    return json.loads(data)


@pytest.fixture(scope="module")
def driven(bundle, tmp_path_factory):
    """The report of a judged drive, which nobody changes."""
    folder = tmp_path_factory.mktemp("driven") / "r"
    drive(bundle, folder, judge=lambda *_: ROWS)
    return folder / "report.html"


@pytest.fixture
def show(browser):
    """show(path, …) -> a tab with the report; at the end all are closed, and none complained or asked for anything."""
    tabs = []

    def opened(path, **options):
        tabs.append(browser.open(path.as_uri(), **options))
        tabs[-1].until("window.edgemap?.updates === 1 && !edgemap.map.asked")
        return tabs[-1]

    yield opened
    for tab in tabs:
        assert tab.said("Runtime.exceptionThrown", "Log.entryAdded", "Page.javascriptDialogOpening") == []
        asked = {event["request"]["url"].partition(":")[0] for event in tab.said("Network.requestWillBeSent")}
        assert asked <= {"file", "data"}
        tab.close()


def text_of(tab, selector):
    return tab.value(f"document.querySelector({selector!r}).textContent")


def test_it_shows_the_map_that_the_run_saved(bundle, tmp_path, show):
    report = drive(bundle, tmp_path / "r", judge=lambda objects, frames: ROWS)
    assert (report.failure, report.evaluation_rows) == ("", ROWS)
    data = data_of(tmp_path / "r")
    (saved,) = json.loads((tmp_path / "r" / "map.json").read_text())["objects"]
    assert saved.items() <= data["update"]["changed"][0].items()
    assert data["run"]["stages"] == json.loads((tmp_path / "r" / "run.json").read_text())["stages_ms"]
    assert len(data["update"]["trail"]) == 30
    tab = show(tmp_path / "r" / "report.html")
    assert tab.value("[...edgemap.map.objects.keys()]") == ["chair-1"]
    assert "found, 0.25 m off" in text_of(tab, "#objects li")
    assert text_of(tab, "#missed li") == "bed at x 1.00, y 2.00 m"
    words = text_of(tab, "#run")
    assert "1 found, 1 missed" in words
    assert "0.290 m at the end" in words  # 29 frames of 1 cm to the side
    assert all(stage in words for stage in data["run"]["stages"])
    tab.value("document.querySelector('#objects button').click()")
    tab.until("document.querySelector('#detail img').naturalWidth > 0 && edgemap.map.chosen === 'chair-1'")
    detail = text_of(tab, "#detail").replace("\u00a0", " ")
    assert f"x {saved['x_m']:.2f}, y {saved['y_m']:.2f} m".replace("-", "−") in detail
    assert f"{saved['count']} times" in detail
    assert "in its 95 % ellipse" in detail
    tab.until("document.querySelector('.mount').naturalWidth > 0")
    tab.value("document.getElementById('replay-at').value = 10; document.getElementById('replay-at').oninput(); true")
    place = data["run"]["replay"][10]["pose"][0]
    tab.until(f"document.getElementById('replay-time').textContent === '1.0 s' && edgemap.map.pose[0] === {place}")
    tab.until("document.getElementById('caption').textContent.startsWith('frame 11')")
    hidden = ".actions, #edit, #follow, .mounting, #figures, #sightings"
    assert not tab.value(f"[...document.querySelectorAll('{hidden}')].some(part => part.checkVisibility())")
    assert tab.value("document.querySelectorAll('#detail input, #detail select').length") == 0


def test_the_path_is_coloured_by_time_and_by_trust(driven, show):
    tab = show(driven)
    colours = "[0, 1].map(share => edgemap.map.path.colour(edgemap.map.style, share))"
    assert text_of(tab, "#ramp-to") == "2.9 s"
    by_time = tab.value(colours)
    tab.click("by-trust")
    tab.until("document.getElementById('ramp-to').textContent === '±1 m or more'")
    assert len({*by_time, *tab.value(colours)}) == 4


def test_doubtful_objects_are_hidden_until_asked_for(driven, tmp_path, show):
    path, data = tmp_path / "report.html", data_of(driven.parent)
    (item,) = data["update"]["changed"]
    data["update"]["changed"] = [item, item | {"id": "chair-2", "x_m": 1.0, "doubtful": True}]
    path.write_text(re.sub(r'(<script id="run-data"[^>]*>).*?(</script>)', lambda m: m[1] + json.dumps(data) + m[2],
                           driven.read_text()))  # fmt: skip
    tab = show(path)
    names = "[...document.querySelectorAll('#objects li')].map(li => li.dataset.id).sort()"
    assert tab.value(names) == ["chair-1"]
    assert text_of(tab, "#doubtful") == "Show 1 doubtful"
    tab.click("doubtful")
    assert tab.value(names) == ["chair-1", "chair-2"]
    assert tab.value("edgemap.map.shown().length") == 2
    tab.click("doubtful")
    assert tab.value(names) == ["chair-1"]


@pytest.mark.skipif(find_axe() is None, reason="needs axe-core")
@pytest.mark.parametrize(("scheme", "size"), [("light", {}), ("dark", PHONE)])
def test_axe_finds_no_serious_fault_and_all_fits(driven, show, scheme, size):
    tab = show(driven, prefers_color_scheme=scheme, **size)
    assert tab.value("document.documentElement.scrollWidth") <= size.get("width", 1440)
    assert serious_faults(tab) == []
    tab.value("document.querySelector('#objects button').click()")
    tab.value("document.querySelectorAll('details').forEach(fold => { fold.open = true; })")
    assert serious_faults(tab) == []


HOSTILE = [
    "</script><script>window.hurt = 1</script>", "</style></title><svg onload=window.hurt=1>", "<!-- <b>",
    "]]> <![CDATA[", "\"><img src=x onerror=window.hurt=1>", "'><iframe src=http://127.0.0.1:9/>", "&lt;script&gt;",
    "a\u202eb\u0000\ud800",
]  # fmt: skip


def test_hostile_names_are_text_in_a_browser_even_without_the_policy(bundle, tmp_path, show):
    """Names of the camera, of objects, zones and truth, and settings; escaping alone must hold."""
    plain = [text for text in HOSTILE if text.isprintable()]
    rows = [EvaluationRow("missed", text, None, (1.0, 2.0)) for text in HOSTILE]
    corners = ((0.0, 0.0), (1.0, 0.0), (1.0, 1.0))
    named = [(20, Edit("zone", name=text, corners_m=corners)) for text in plain]
    named.append((20, Edit("name", "chair-1", name=plain[4])))
    record = {"camera": HOSTILE[0], "bundle": dict.fromkeys(HOSTILE, HOSTILE)}
    report = drive(bundle, tmp_path / "r", record=record, judge=lambda *_: rows, edits=Edits(None, named))
    assert report.failure == ""
    text = (tmp_path / "r" / "report.html").read_text()
    policy = re.search(r'<meta http-equiv="Content-Security-Policy" content="([^"]*)">', text)
    assert policy[1].startswith("default-src 'none'; img-src data:; style-src 'unsafe-inline'; script-src 'sha256-")
    bare = tmp_path / "bare.html"
    bare.write_text(text.replace(policy[0], ""))
    tab = show(bare)
    told = "[window.hurt ?? 0, document.scripts.length, document.querySelectorAll('iframe').length]"
    assert tab.value(told) == [0, 2, 0]
    shown = tab.value("document.documentElement.innerHTML.length && document.body.textContent")
    rendered = shown.partition('{"about"')[0] + shown.rpartition("</script>")[2]
    assert [name for name in plain if name not in rendered] == []


def test_runs_that_end_early_still_give_a_page_with_their_fault(bundle, tmp_path, show):
    with pytest.raises(CameraError):
        drive(bundle, tmp_path / "r", fails_at=8)
    update = data_of(tmp_path / "r")["update"]
    assert "memory: the cable came off" in json.dumps(update["faults"])
    assert update["fault_count"] == 1
    assert update["changed"][0]["id"] == "chair-1"
    with pytest.raises(CameraError):
        drive(bundle, tmp_path / "none", 3, fails_at=0)
    assert "No object on the map" in text_of(show(tmp_path / "none" / "report.html"), "#guide")


@pytest.mark.parametrize("count", [1, 2])
def test_short_runs_without_truth(bundle, tmp_path, count, show):
    assert drive(bundle, tmp_path / "r", count, truth=False).failure == ""
    assert data_of(tmp_path / "r")["run"]["truth"] is None
    assert "Against the truth" not in text_of(show(tmp_path / "r" / "report.html"), "#run")


@pytest.mark.parametrize("where", ["report_page", "BestCrops"])
def test_a_report_that_fails_costs_neither_map_nor_run(bundle, tmp_path, monkeypatch, where):
    def broken(*_):
        raise ZeroDivisionError("no such luck")

    if where == "report_page":
        monkeypatch.setattr(sink_module, "report_page", broken)
    else:
        monkeypatch.setattr(sink_module.BestCrops, "consider", broken)
    report = drive(bundle, tmp_path / where)
    record = json.loads((tmp_path / where / "run.json").read_text())
    said = report.failure if where == "report_page" else record["faults"][0]["text"]
    assert "ZeroDivisionError: no such luck" in said
    assert json.loads((tmp_path / where / "map.json").read_text())["objects"]
    assert (record["finished"], record["frames"]) == (True, 30)
