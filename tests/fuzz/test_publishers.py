"""Any names, labels and places of a map become valid messages of each publisher; the page answers any request."""

import asyncio
import csv
import json
import math
from contextlib import closing
from xml.etree import ElementTree

import numpy as np
import pytest
import yaml
from hypothesis import given, reject, settings
from hypothesis import strategies as st
from support.broker import MISSING, Broker
from support.fuzzed_room import fuzz
from support.recordings import LENS, MOUNT, noise
from support.results import POSES, results, run_info
from support.steps import Steps

from edgemap.bridges.ros2.messages.definitions import decoder, encoder
from edgemap.bridges.ros2.messages.stream import MessageStream
from edgemap.bridges.ros2.messages.topics import OBJECTS
from edgemap.geometry.errors import MapError
from edgemap.geometry.map_object import MapObject
from edgemap.geometry.objects.annotations import Annotations, Zone
from edgemap.runtime.outputs.map_formats.drawing import DrawnMap, map_svg
from edgemap.runtime.outputs.map_formats.geojson import geojson_text
from edgemap.runtime.outputs.map_formats.nav2 import vector_text
from edgemap.runtime.outputs.map_formats.table import csv_text
from edgemap.runtime.step.map_file import map_document, read_map, saved_text
from edgemap.view.app import make_app
from edgemap.view.page import LivePage
from edgemap.view.pause import Pause

PIECES = (
    "chair", "-1", "=1+1", "@SUM", "<script>", "</svg>", "&amp;", "\"'", "`", "$(id)", "%s", "{0}", "..", "/", "#+",
    "\\", ";", ",", "é", "ﷺ", "🪑", "\U0010ffff", "9" * 80, "null", "true", "~", "-", ": ", "!!python", "*", "?", "|",
    "%00", "\u202e",
)  # fmt: skip
texts = st.lists(st.sampled_from(PIECES) | st.text(max_size=6), min_size=1, max_size=4).map("".join)
names = texts.map(lambda text: "".join(filter(str.isprintable, text))[:80] or "x")
metres = st.floats(-1e4, 1e4)
places = st.tuples(metres, metres).map(np.array)
things = st.builds(
    MapObject, names, names, places, st.floats(1e-6, 100.0).map(lambda variance: np.eye(2) * variance),
    st.floats(0.0, 5.0), st.floats(0.0, 5.0), st.integers(1, 10**6), st.floats(0.0, 1.0), st.just(0.0), st.just(1.0),
    st.just(()), st.dictionaries(names, st.floats(0.0, 1.0), max_size=2), names, st.booleans(),
)  # fmt: skip
zones = st.builds(Zone, names, names, st.just(((0.0, 0.0), (1.0, 0.0), (1.0, 1.0))))


@st.composite
def maps(draw):
    """Objects and annotations of a map file that edgemap reads."""
    objects, areas = draw(st.lists(things, max_size=4)), draw(st.lists(zones, max_size=2))
    try:
        return read_map(saved_text(map_document(objects, Annotations(tuple(areas)))).encode(), "a map")
    except MapError:
        reject()


few = settings(fuzz(1), max_examples=20)
(STEP,) = results(noise(1), POSES[:1])


@few
@given(maps())
def test_files_of_a_map_hold_its_objects_and_no_code(drawn):
    objects, annotations = drawn
    rows = list(csv.DictReader(csv_text(objects).splitlines()))
    assert len(rows) == len(objects)
    assert not any(row[name].startswith(("=", "+", "-", "@")) for row in rows for name in ("id", "label", "name"))
    features = json.loads(geojson_text(objects, annotations=annotations))["features"]
    assert len({json.dumps(feature["id"]) for feature in features}) == len(features)
    shapes = yaml.safe_load(vector_text(objects))["vector_object_server"]["ros__parameters"].get("shapes", [])
    assert len(set(shapes)) == len(objects)
    drawing = ElementTree.fromstring(map_svg(DrawnMap(objects)))
    assert not [part.tag for part in drawing.iter() if part.tag.endswith("script")]


@few
@given(maps())
def test_ros_2_messages_are_read_back(drawn):
    """Those of `--ros2`, `--foxglove` and of recordings."""
    objects, _ = drawn
    read = {}
    for outgoing in MessageStream(LENS, MOUNT).step(STEP, objects):
        read[outgoing.topic] = decoder(outgoing.topic.kind)(encoder(outgoing.topic.kind)(outgoing.make()))
    detections = read[OBJECTS].detections
    assert [item.id for item in detections] == [item.id for item in objects]
    assert [item.results[0].hypothesis.class_id for item in detections] == [item.label for item in objects]
    for item, detection in zip(objects, detections, strict=True):
        at = detection.bbox.center.position
        assert (at.x, at.y) == pytest.approx(tuple(item.position_m))


@pytest.mark.skipif(bool(MISSING), reason=f"not here: {', '.join(MISSING)}")
def test_a_broker_keeps_every_object(tmp_path):
    pytest.importorskip("paho.mqtt")
    from edgemap.bridges.mqtt.sink import MqttPublisher, topic_level

    broker = Broker(tmp_path)
    with closing(MqttPublisher("127.0.0.1", broker.port, run_info("robo/+#"))) as sink:

        @settings(few, max_examples=6)
        @given(maps())
        def sent(drawn):
            objects, _ = drawn
            topics = {f"edgemap/robo___/objects/{topic_level(item.id)}" for item in objects}
            sink.write(STEP, objects)
            told = broker.retained("edgemap/robo___/objects/+", lambda told: told.keys() == topics)
            assert {json.loads(text)["label"] for text in told.values()} <= {item.label for item in objects}

        sent()
    broker.stop()


TOKEN, COOKIE = "t0ken-t0ken-t0ken", "edgemap-1"
HOST = {"host": "127.0.0.1:8090"}
READ = (
    "/", "/main.js", "/api/run", "/api/health", "/api/faults", "/api/pose", "/api/frame", "/api/picture", "/api/map",
    "/api/objects", "/api/objects/chair-1", "/api/objects/chair-1/picture", "/api/openapi.yaml", "/api/rooms",
)  # fmt: skip
CORNERS = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]]
WRITTEN = (
    ("PATCH", "/api/objects/chair-1", {"name": "mine", "confirmed": True, "x_m": 1.0, "y_m": 0.5}),
    ("POST", "/api/objects", {"label": "chair", "x_m": 1.0, "y_m": 0.5, "width_m": 0.5}),
    ("POST", "/api/objects/couch-1/merge", {"into": "chair-1"}),
    ("DELETE", "/api/objects/chair-1", {}),
    ("POST", "/api/objects/chair-1/restore", {}),
    ("POST", "/api/zones", {"name": "desk", "corners_m": CORNERS}),
    ("PUT", "/api/zones/zone-1", {"name": "desk", "corners_m": CORNERS}),
    ("POST", "/api/pause", {"paused": True}),
    ("POST", "/api/save", {}),
)
values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=8), inner, max_size=3),
    max_leaves=6,
)


@st.composite
def requests(draw):
    """Method, path, headers and body: a valid request with some of it changed."""
    method, path, body = draw(st.sampled_from([*WRITTEN, *(("GET", path, {}) for path in READ)]))
    if body and draw(st.booleans()):
        body = body | {draw(st.sampled_from(sorted(body))): draw(values)}
    data = draw(st.just(json.dumps(body).encode()) | st.binary(max_size=40) | st.just(b"[" * 9000))
    method = draw(st.just(method) | st.sampled_from(("GET", "POST", "HEAD", "OPTIONS", "get", "", "X" * 99)))
    path = draw(st.just(path) | st.text(max_size=30).map(lambda text: f"/{text}") | st.just("/../page.py"))
    valid = {"authorization": f"Bearer {TOKEN}", "content-type": "application/json", "origin": "http://127.0.0.1:8090"}
    headers = {name: value for name, value in valid.items() if draw(st.booleans())}
    texts = "evil.example", "[::1", "null", "-1", "9" * 30, "=;=;=", "é=é; " * 1000, "", f"{COOKIE}={TOKEN}"
    odd = st.sampled_from(texts)
    keys = st.sampled_from(("host", "cookie", "origin", "content-length", "range"))
    headers |= draw(st.dictionaries(keys, odd, max_size=2))
    return method, path, HOST | headers, data


def asked(app, step, method, path, headers, data=b""):
    """Status and body of the answer. step: what the run does meanwhile."""
    scope = {
        "type": "http", "asgi": {"version": "3.0"}, "http_version": "1.1", "method": method, "path": path,
        "root_path": "",
        "raw_path": path.encode("utf-8", "surrogateescape"), "query_string": b"", "scheme": "http",
        "headers": [(name.encode(), value.encode("latin-1", "replace")) for name, value in headers.items()],
        "client": ("10.0.0.1", 5), "server": ("127.0.0.1", 8090),
    }  # fmt: skip
    waiting, sent = [{"type": "http.request", "body": data, "more_body": False}], []

    async def receive():
        return waiting.pop(0) if waiting else {"type": "http.disconnect"}

    async def send(message):
        sent.append(message)

    async def serve():
        async def drive():
            while True:
                step()
                await asyncio.sleep(0.0005)

        run = asyncio.create_task(drive())
        try:
            await asyncio.wait_for(app(scope, receive, send), 10.0)
        finally:
            run.cancel()

    asyncio.run(serve())
    assert sent[0]["type"] == "http.response.start"
    return sent[0]["status"], b"".join(message.get("body", b"") for message in sent[1:])


def page_of(folder):
    """A page of twelve steps, and what the run does between two."""
    steps = Steps()
    page = LivePage({"camera": "demo", "live": False, "rate_hz": 10.0, "marks": {}}, folder, Pause())
    steps.into(page, 12)
    return page, lambda: page.edits.apply(steps.mapper, 12)


@few
@given(maps())
def test_the_page_tells_every_map(tmp_path_factory, drawn):
    objects, _ = drawn
    page, step = page_of(tmp_path_factory.mktemp("page"))
    page.write(page.newest.result, objects)
    app = make_app(page)
    for path in READ:
        status, body = asked(app, step, "GET", path, HOST)
        assert status in (200, 404)
        if path == "/api/objects":
            told = json.loads(body)
            assert sorted(item["id"] for item in told) == sorted(item.id for item in objects)
            assert all(math.isfinite(item["x_m"]) for item in told)


def test_the_page_answers_every_request(tmp_path):
    page, step = page_of(tmp_path)
    app = make_app(page, TOKEN, COOKIE)

    @settings(few, max_examples=100)
    @given(requests())
    def answered(request):
        method, path, headers, data = request
        status, _ = asked(app, step, method, path, headers, data)
        assert status < 500 or status == 503
        if not any(TOKEN in value for value in headers.values()):
            assert status >= 400

    answered()
