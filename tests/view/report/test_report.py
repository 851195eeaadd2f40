"""The report as a browser reads it: well-formed, asks for nothing, says what map.json says."""

import base64
import json
import re
from html.parser import HTMLParser

import cv2
import numpy as np
import pytest
from support import painted
from support.axe import find_axe, serious_faults
from support.made_camera import MadeCamera, raising

from edgemap.geometry.camera.floor import FloorCamera
from edgemap.geometry.camera.intrinsics import Intrinsics
from edgemap.geometry.camera.mount import Mount
from edgemap.geometry.objects.edits import Edit
from edgemap.geometry.objects.evaluation_row import EvaluationRow
from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.errors import CameraError
from edgemap.runtime.frames.trajectory import Trajectory
from edgemap.runtime.motion.odometry.recorded import RecordedOdometry
from edgemap.runtime.network.bundle import load_bundle
from edgemap.runtime.outputs.sinks.run_folder import RunFolder
from edgemap.runtime.step.edits import Edits
from edgemap.runtime.step.loop import run
from edgemap.runtime.step.mapper import Mapper
from edgemap.runtime.step.pipeline import Pipeline
from edgemap.runtime.step.slam import SemanticSlam
from edgemap.view.report import sink as sink_module
from edgemap.view.report.sink import ReportFile

FLOOR = FloorCamera(Intrinsics(64, 64, 50.0, 50.0, 31.5, 31.5), Mount(1.0))
SCENE = [("chair", 40.0, 30.0, 12.0, 24.0, 0.9), ("person", 10.0, 40.0, 8.0, 20.0, 0.8)]
VOID = {"meta", "img", "br", "hr", "link"}
NASTY = "<script>alert('x')</script> & \"quoted\""


SCENERY = np.random.default_rng(0).integers(0, 255, (64, 64, 3), dtype=np.uint8)


class Page(HTMLParser):
    """Checks that every element is closed in order, and gathers texts, tags and attributes."""

    def __init__(self, text):
        super().__init__()
        self.open, self.tags, self.texts = [], [], []
        self.feed(text)
        assert self.open == []

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.texts.append(data)

    @property
    def text(self):
        return " ".join(self.texts)

    def addresses(self):
        names = ("src", "href", "xlink:href", "srcset", "action", "data", "poster", "xmlns")
        return [value for _, attributes in self.tags for name, value in attributes.items() if name in names]


@pytest.fixture(scope="module")
def bundle(tmp_path_factory):
    return load_bundle(painted.write_painted(tmp_path_factory.mktemp("bundles") / "b", SCENE, odometry=False))


def drive(bundle, folder, count=30, fails_at=None, record=None, truth=True, judge=None, edits=None):
    way = Trajectory(1e9 + np.arange(count) / 10, tuple(SE2(0.002 * i, 0, 0) for i in range(count)))
    real = Trajectory(way.stamps_s, tuple(SE2(0.002 * i, 0.01 * i, 0) for i in range(count)))
    pipeline = SemanticSlam(Pipeline(bundle, FLOOR, RecordedOdometry(way, "test")), Mapper())
    report = ReportFile(folder, real if truth else None, judge)
    record = {"camera": "memory", "mapped": ["chair"], **(record or {})}
    sinks = [RunFolder(folder, FLOOR, record), report]
    fails = raising(fails_at, CameraError(f"memory: the cable came off {NASTY}"))
    run(MadeCamera(count, lambda _: SCENERY, start_s=1e9, before=fails), pipeline, sinks, edits=edits)
    return report


def page_of(folder):
    return Page((folder / "report.html").read_text())


def test_it_says_what_map_json_says(bundle, tmp_path):
    evaluation_rows = [
        EvaluationRow("found", "chair", "chair-1", (5.0, -0.9), 0.25, True, ((4, -1), (6, -1), (6, 0))),
        EvaluationRow("missed", "bed", None, (1.0, 2.0)),
    ]
    report = drive(bundle, tmp_path / "r", judge=lambda objects, frames: evaluation_rows)
    assert report.failure == ""
    assert report.evaluation_rows == evaluation_rows
    text = page_of(tmp_path / "r").text
    objects = json.loads((tmp_path / "r" / "map.json").read_text())["objects"]
    assert len(objects) == 1
    for item in objects:
        assert item["id"] in text
        assert f"{item['x_m']:.2f}, {item['y_m']:.2f} m" in text
        assert f"{item['width_m']:.2f} × {item['height_m']:.2f} m" in text
        assert f"{item['count']}×" in text
    stages = json.loads((tmp_path / "r" / "run.json").read_text())["stages_ms"]
    for name, figures in stages.items():
        assert name in text
        assert all(f"{figures[key]:.2f}" in text for key in ("p50", "p95", "p99"))
    assert "1 found, 1 missed" in text
    assert [tag for tag, _ in page_of(tmp_path / "r").tags].count("table") == 3  # objects, stages, configuration
    assert all(
        told in text for told in ("0.25 m", "yes", "bed", "1.00, 2.00 m")
    )  # the truth stands in the objects' table
    assert "0.290 m at the end" in text  # 29 frames of 1 cm to the side


def test_it_asks_for_nothing(bundle, tmp_path):
    drive(bundle, tmp_path / "r")
    text = (tmp_path / "r" / "report.html").read_text()
    addresses = Page(text).addresses()
    kinds = sorted(address.partition(";base64,")[0] for address in addresses)
    assert kinds == ["data:image/jpeg", "data:image/jpeg", "data:image/png"]  # the chair's, the mount's, and the floor
    for address in addresses:
        data = np.frombuffer(base64.b64decode(address.partition(",")[2]), np.uint8)
        assert cv2.imdecode(data, cv2.IMREAD_COLOR) is not None
    assert not re.search(r"https?://|url\(|@import|<script|<link", text)
    policies = [tag[1]["content"] for tag in Page(text).tags if "http-equiv" in tag[1]]
    assert policies == ["default-src 'none'; img-src data:; style-src 'unsafe-inline'"]


@pytest.mark.skipif(find_axe() is None, reason="needs axe-core")
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_axe_finds_no_serious_fault(bundle, tmp_path, browser, scheme):
    drive(bundle, tmp_path / "r")
    tab = browser.open((tmp_path / "r" / "report.html").as_uri(), prefers_color_scheme=scheme)
    tab.until("document.readyState === 'complete' && document.querySelector('h1')")
    assert serious_faults(tab) == []
    tab.close()


def test_special_characters_are_text(bundle, tmp_path):
    drive(bundle, tmp_path / "r", record={"camera": NASTY, "bundle": {"name": NASTY, NASTY: [NASTY]}})
    text = (tmp_path / "r" / "report.html").read_text()
    assert "<script" not in text
    assert Page(text).text.count(NASTY) >= 4


HOSTILE = [
    "</script><script>window.hurt = 1</script>", "</style></title><svg onload=window.hurt=1>", "<!-- <b>",
    "]]> <![CDATA[", "\"><img src=x onerror=window.hurt=1>", "'><iframe src=http://127.0.0.1:9/>", "&lt;script&gt;",
    "a\u202eb\u0000\ud800",
]  # fmt: skip


def test_hostile_names_are_text_in_a_browser_even_without_the_policy(bundle, tmp_path, browser):
    """Names of the camera, of objects, zones and truth, and a fault's text; escaping alone must hold."""
    plain = [text for text in HOSTILE if text.isprintable()]
    rows = [EvaluationRow("missed", text, None, (1.0, 2.0)) for text in HOSTILE]
    corners = ((0.0, 0.0), (1.0, 0.0), (1.0, 1.0))
    named = [(20, Edit("zone", name=text, corners_m=corners)) for text in plain] + [
        (20, Edit("rename", "chair-1", name=plain[4]))
    ]
    record = {"camera": HOSTILE[0], "bundle": dict.fromkeys(HOSTILE, HOSTILE)}
    report = drive(bundle, tmp_path / "r", record=record, judge=lambda *_: rows, edits=Edits(None, named))
    assert report.failure == ""
    text = (tmp_path / "r" / "report.html").read_text()
    bare = tmp_path / "bare.html"
    bare.write_text(re.sub(r"<meta http-equiv[^>]*>", "", text))
    tab = browser.open(bare.as_uri())
    tab.until("document.readyState === 'complete' && document.querySelector('h1')")
    assert tab.value("[window.hurt ?? 0, document.scripts.length, document.querySelectorAll('iframe').length]") == [
        0,
        0,
        0,
    ]
    shown = tab.value("document.documentElement.textContent")
    assert [name for name in plain if name not in shown] == []
    asked = {event["request"]["url"].partition(":")[0] for event in tab.said("Network.requestWillBeSent")}
    assert asked <= {"file", "data"}
    assert tab.said("Runtime.exceptionThrown", "Page.javascriptDialogOpening") == []
    tab.close()


def test_after_a_fault_it_is_there_with_the_fault(bundle, tmp_path):
    with pytest.raises(CameraError):
        drive(bundle, tmp_path / "r", fails_at=8)
    page = page_of(tmp_path / "r")
    assert "memory: the cable came off" in page.text
    assert "1 fault" in page.text
    assert "chair-1" in page.text


@pytest.mark.parametrize("count", [1, 2])
def test_short_runs_without_truth(bundle, tmp_path, count):
    assert drive(bundle, tmp_path / "r", count, truth=False).failure == ""
    assert "Against the truth" not in page_of(tmp_path / "r").text


def test_no_frame_at_all_still_gives_a_page(bundle, tmp_path):
    with pytest.raises(CameraError):
        drive(bundle, tmp_path / "r", 3, fails_at=0)
    assert "Nothing was mapped" in page_of(tmp_path / "r").text


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
    said = report.failure if where == "report_page" else record["faults"][0]
    assert "ZeroDivisionError: no such luck" in said
    assert json.loads((tmp_path / where / "map.json").read_text())["objects"]
    assert (record["finished"], record["frames"]) == (True, 30)
