"""The HTTP API as any program uses it, against its own OpenAPI text; and the page's commands in docs/http-api.md."""

import json
import re
import shlex
import socket
import subprocess
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml
from support.faults import made
from support.http_client import Api
from support.live import raw_viewer

from edgemap.bridges.mcp.maps import open_source
from edgemap.geometry.errors import MapError
from edgemap.runtime.step.map_file import save_map
from edgemap.view import questions
from edgemap.view.api import OPENAPI, api_routes
from edgemap.view.questions import BODY_BYTES
from edgemap.view.updates import ProcessUsage

DOCS = Path(__file__).parents[2] / "docs" / "http-api.md"
SPEC = yaml.safe_load(OPENAPI.read_text())


@pytest.fixture
def robot(serve):
    """(served, api): a page of twelve steps."""
    served = serve(steps=12)
    return served, Api(served.port)


def conforms(path, method, status, body):
    """The answer's body is what the OpenAPI text says."""
    jsonschema = pytest.importorskip("jsonschema")
    answer = SPEC["paths"][path][method.lower()]["responses"][str(status)]
    if "$ref" in answer:
        answer = SPEC["components"]["responses"][answer["$ref"].rsplit("/", 1)[1]]
    schema = answer["content"]["application/json"]["schema"]
    jsonschema.Draft202012Validator(schema | {"components": SPEC["components"]}).validate(body)


def test_the_openapi_text_names_every_address_and_no_other(robot):
    served, api = robot
    routes = {(route.path, name) for route in api_routes(served.page, ProcessUsage()) for name in route.methods or ()}
    routes = {(path, name) for path, name in routes if name != "HEAD"}
    methods = ("get", "post", "put", "patch", "delete")
    wanted = {(path, method.upper()) for path, item in SPEC["paths"].items() for method in item if method in methods}
    assert routes == wanted
    assert api.get("/api/openapi.yaml") == OPENAPI.read_bytes()


def test_every_answer_is_as_the_openapi_text_says(robot):
    served, api = robot
    served.page.fault(made("the wheel came off"))
    for path in ("run", "health", "faults", "changes", "pose", "frame", "map", "objects", "objects/{id}"):
        conforms(f"/api/{path}", "GET", 200, api.get(f"/api/{path}".replace("{id}", "chair-1")))
    for path in ("/api/objects", "/api/objects/none", "/nowhere"):  # none may be framed or kept
        headers = api("GET", path)[1]
        assert headers["cache-control"] == "no-store"
        assert "frame-ancestors 'none'" in headers["content-security-policy"]


def test_before_the_first_picture_there_is_nothing_to_tell(serve):
    api = Api(serve().port)
    for path in ("pose", "frame", "picture", "objects/chair-1"):
        status, _, body = api("GET", f"/api/{path}")
        assert (status, body) == (503, {"error": "no picture yet"})
    assert api.get("/api/objects") == []
    waiting = {"level": "ok", "headline": "Waiting for the first picture.", "problems": []}
    assert api.get("/api/health")["status"] == waiting


def test_it_tells_what_the_run_knows(robot, tmp_path):
    """The chair stands at (3, 1), the couch at (4, -1.5); after twelve steps of 5 cm the robot is at (0.55, 0)."""
    served, api = robot
    pose = api.get("/api/pose")
    assert (pose["frame"], pose["x_m"], pose["y_m"]) == (11, pytest.approx(0.55), pytest.approx(0.0))
    chair, couch = api.get("/api/objects")
    assert (chair["id"], couch["id"]) == ("chair-1", "couch-1")
    assert chair["distance_m"] == pytest.approx(np.hypot(2.45, 1.0), abs=0.02)
    assert couch["distance_m"] == pytest.approx(np.hypot(3.45, 1.5), abs=0.02)
    assert (chair["in_view"], chair["age_s"]) == (True, 0.0)
    assert api.get("/api/objects/couch-1") == couch
    boxes = {box["label"]: box for box in api.get("/api/frame")["boxes"]}
    assert boxes["chair"]["distance_m"] == pytest.approx(np.hypot(2.45, 1.0), abs=1e-3)
    assert boxes["person"]["distance_m"] is None
    save_map(tmp_path / "map.json", served.page.objects)
    assert api("GET", "/api/map")[1]["content-disposition"] == 'attachment; filename="map.json"'
    saved = Api(served.port).get("/api/map")
    assert [item["id"] for item in saved["objects"]] == ["chair-1", "couch-1"]


def test_pictures_are_jpegs_of_the_newest_frame_and_of_the_object(robot):
    served, api = robot
    served.page.crops.consider(served.page.newest.result)
    for path, shape in (("/api/picture", (240, 320, 3)), ("/api/objects/chair-1/picture", None)):
        status, headers, data = api("GET", path)
        assert (status, headers["content-type"], headers["x-frame"]) == (200, "image/jpeg", "11")
        picture = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
        assert shape in (None, picture.shape)
    status, _, body = api("GET", "/api/objects/chair-9")
    assert (status, body) == (404, {"error": "no object 'chair-9' on the map"})


def test_without_pictures_no_pixel_leaves(serve):
    """No address that is read, nor the stream, has bytes of a JPEG or PNG, plain or in base64."""
    served = serve()
    served.page.pictures = False
    served.step(12)
    served.page.crops.consider(served.page.newest.result)
    api, sent = Api(served.port), b""
    for path in (path for path, methods in SPEC["paths"].items() if "get" in methods):
        status, headers, body = api("GET", path.replace("{id}", "chair-1"))
        sent += body if isinstance(body, bytes) else repr(body).encode()
        assert (status == 403) == path.endswith("/picture")
        assert not headers.get("content-type", "").startswith("image/")
    with raw_viewer(served.port, stream=True) as viewer:
        update = viewer.update()
    assert update.pop("jpeg") == b""
    sent += json.dumps(update).encode()
    assert b"chair-1" in sent
    assert not re.search(rb"\xff\xd8\xff|\x89PNG|/9j/|iVBORw0KGgo|\\xff\\xd8", sent)


def test_pause_and_save_act_and_answer(robot, serve, tmp_path):
    served, api = robot
    for paused, state in ((True, "paused"), (False, "running")):
        status, _, body = api("POST", "/api/pause", {"paused": paused})
        assert (status, body) == (200, {"state": state})
        assert served.page.pause.paused is paused
    status, _, body = api("POST", "/api/save", {})
    assert (status, body) == (200, {"path": str(tmp_path / "map-000011.json")})
    saved = json.loads((tmp_path / "map-000011.json").read_text())
    assert saved.pop("saved_at")
    assert saved == json.loads(served.page.map_text())
    served.page.close()
    assert api("POST", "/api/pause", {"paused": True})[0] == 409
    status, _, body = Api(serve(live=True).port)("POST", "/api/pause", {"paused": True})
    assert (status, body) == (409, {"error": "the camera is live: it cannot be paused"})


def test_wrong_bodies_are_refused_in_one_line(robot):
    served, api = robot
    wrong = [b"", b"no json", b"[]", b'{"paused":3}', b'{"paused":true,"more":1}', b'{"paused":"\xff"}', b"[" * 5000]
    for body in wrong:
        status, _, items = api("POST", "/api/pause", body, Content_Type="application/json")
        assert status == 400, body
        assert "\n" not in items["error"]
    too_long = b'{"paused":' + b" " * BODY_BYTES + b"true}"
    assert api("POST", "/api/pause", too_long, Content_Type="application/json")[0] == 413
    for kind in ("text/plain", "application/x-www-form-urlencoded", "multipart/form-data"):  # what a form can send
        assert api("POST", "/api/pause", b'{"paused":true}', Content_Type=kind)[0] == 415
    assert api("GET", "/api/pause")[0] == 405
    assert not served.page.pause.paused


def test_the_pages_commands_run_in_order(robot, tmp_path):
    served, _ = robot
    served.page.crops.consider(served.page.newest.result)
    blocks = re.findall(r"```sh\n(.*?)```", DOCS.read_text(), re.S)
    lines = [line for block in blocks for line in block.replace("\\\n", " ").splitlines()]
    commands = [line for line in lines if line.startswith("curl")]
    assert len(commands) >= 10
    for line in commands:
        line = line.replace("http://127.0.0.1:8090", f"http://127.0.0.1:{served.port}")
        words = shlex.split(line, comments=True)
        words[1:1] = ["--fail-with-body", "--noproxy", "*"]
        result = subprocess.run(words, cwd=tmp_path, capture_output=True, check=False, timeout=30)
        assert result.returncode == 0, (line, result.stdout, result.stderr)


def test_the_stream_is_as_the_page_says(robot):
    served, _ = robot
    with raw_viewer(served.port, stream=True) as viewer:
        update = viewer.update()
    assert update["zones"] == []
    items = re.findall(r"^\| `(\w+)`", DOCS.with_name("http-stream.md").read_text(), re.M)
    assert set(items) == set(update) - {"jpeg"} | {"sightings"}


def test_a_person_edits_the_map(robot):
    """Name, confirmation, deletion and its way back, a merge and its way back: seen by the next request at once."""
    served, api = robot
    status, _, chair = api("PATCH", "/api/objects/chair-1", {"name": "Grandma's <b>chair</b>", "confirmed": True})
    conforms("/api/objects/{id}", "PATCH", status, chair)
    assert (chair["name"], chair["confirmed"], chair["confidence"]) == ("Grandma's <b>chair</b>", True, 1.0)
    status, _, body = api("DELETE", "/api/objects/couch-1")
    conforms("/api/objects/{id}", "DELETE", status, body)
    assert [item["id"] for item in api.get("/api/objects")] == ["chair-1"]
    saved = api.get("/api/map")
    conforms("/api/map", "GET", 200, saved)
    assert [item["id"] for item in saved["deleted"]] == ["couch-1"]
    served.step(3)  # it is seen again, and stays off the map
    assert [item["id"] for item in api.get("/api/objects")] == ["chair-1"]
    assert api("POST", "/api/objects/couch-1/restore", {})[0] == 200
    before = served.page.map_text()
    status, _, preview = api("GET", "/api/objects/couch-1/merge?into=chair-1")
    conforms("/api/objects/{id}/merge", "GET", status, preview)
    assert served.page.map_text() == before  # shown before it is made
    status, _, body = api("POST", "/api/objects/couch-1/merge", {"into": "chair-1"})
    conforms("/api/objects/{id}/merge", "POST", status, body)
    assert body["label"] == preview["label"] == max(body["labels"], key=body["labels"].__getitem__)
    assert (body["x_m"], body["count"]) == (pytest.approx(preview["x_m"]), preview["count"])
    assert (body["id"], body["count"]) == ("chair-1", 30)  # fifteen of each
    assert api("POST", "/api/objects/couch-1/restore", {})[0] == 200
    assert len(api.get("/api/objects")) == 2
    assert api("PATCH", "/api/objects/chair-1", {"name": "", "confirmed": False})[2].keys() == chair.keys() - {
        "name", "confirmed",
    }  # fmt: skip


def test_zones_are_drawn_changed_and_dropped(robot):
    _, api = robot
    square = {"name": "window side", "corners_m": [[2, 0], [4, 0], [4, 2], [2, 2]]}
    status, _, zone = api("POST", "/api/zones", square)
    conforms("/api/zones", "POST", status, zone)
    assert zone == square | {"id": "zone-1", "objects": ["chair-1"]}
    status, _, zone = api("PUT", "/api/zones/zone-1", square | {"name": "door side"})
    conforms("/api/zones/{id}", "PUT", status, zone)
    conforms("/api/zones", "GET", 200, api.get("/api/zones"))
    assert [zone["name"] for zone in api.get("/api/map")["zones"]] == ["door side"]
    status, _, answer = api("POST", "/api/zones", square | {"name": " Door side"})  # names must differ
    conforms("/api/zones", "POST", status, answer)
    assert (status, answer["error"]) == (409, "zone-1 is called 'door side' already: give this zone another name")
    assert api("DELETE", "/api/zones/zone-1")[2] == {"id": "zone-1"}
    assert api.get("/api/zones") == []
    assert api("POST", "/api/zones", square)[2]["id"] == "zone-2"  # no id is given twice


def test_a_room_of_the_floor_plan_becomes_a_named_zone(robot):
    served, api = robot
    conforms("/api/rooms", "GET", 200, api.get("/api/rooms"))
    assert api.get("/api/rooms") == []  # nothing is closed yet
    served.sees_a_room()
    (room,) = rooms = api.get("/api/rooms")
    conforms("/api/rooms", "GET", 200, rooms)
    assert room["area_m2"] == pytest.approx(12.0, rel=0.08)
    status, _, zone = api("POST", "/api/zones", {"name": "kitchen", "corners_m": room["corners_m"]})
    assert (status, zone["name"], zone["objects"]) == (201, "kitchen", ["chair-1"])
    status, _, room = api("PATCH", "/api/rooms/room-1", {"name": "den"})
    conforms("/api/rooms/{id}", "PATCH", status, room)
    assert (room["name"], room["objects"]) == ("den", ["chair-1"])
    conforms("/api/rooms/{id}", "PATCH", *api("PATCH", "/api/rooms/room-9", {"name": "den"})[::2])
    conforms("/api/doors", "GET", 200, api.get("/api/doors"))


def test_an_object_is_corrected_and_measured_again(robot):
    served, api = robot
    before = api.get("/api/objects/chair-1")
    wish = {"label": "bench", "x_m": 2.0, "y_m": -1.0, "depth_m": 0.4, "yaw_rad": 1.5}
    status, _, item = api("PATCH", "/api/objects/chair-1", wish)
    conforms("/api/objects/{id}", "PATCH", status, item)
    assert item["corrected"] == ["label", "position", "size", "yaw"]
    assert (item["label"], item["labels"], item["x_m"], item["y_m"]) == ("bench", {"bench": 1.0}, 2.0, -1.0)
    assert item["footprint_m"] == [before["footprint_m"][0], 0.4]
    served.step(3)  # and it stays so while the chair is seen elsewhere
    assert api.get("/api/objects/chair-1")["x_m"] == 2.0
    assert api("POST", "/api/objects/chair-1/restore", {})[0] == 200
    again = api.get("/api/objects/chair-1")
    assert (again["label"], again["x_m"]) == ("chair", pytest.approx(before["x_m"], abs=0.05))
    assert "corrected" not in again


def test_an_object_is_added_and_becomes_what_is_detected_there(robot):
    served, api = robot
    status, _, plant = api("POST", "/api/objects", {"label": "potted plant", "x_m": 1.0, "y_m": 2.0, "name": "fern"})
    conforms("/api/objects", "POST", status, plant)
    assert (plant["id"], plant["name"], plant["confirmed"]) == ("potted plant-added-1", "fern", True)
    assert plant["footprint_m"] == [0.4, 0.4]
    _, _, chair = api("POST", "/api/objects", {"label": "chair", "x_m": 3.1, "y_m": 1.0})
    served.step()
    found = {item["id"]: item for item in api.get("/api/objects")}
    assert set(found) == {"couch-1", "potted plant-added-1", chair["id"]}  # the chair that is seen there is this one
    assert found[chair["id"]]["count"] > 10
    assert api("DELETE", "/api/objects/potted%20plant-added-1")[0] == 200
    assert [item["id"] for item in api.get("/api/map")["deleted"]] == ["potted plant-added-1"]
    assert api("POST", "/api/objects/potted%20plant-added-1/restore", {})[0] == 200
    assert api.get("/api/objects/potted%20plant-added-1")["name"] == "fern"


def test_an_object_that_leaves_its_zone_is_an_event(robot):
    served, api = robot
    assert api.get("/api/events") == []
    api("POST", "/api/zones", {"name": "corner", "corners_m": [[2, 0], [4, 0], [4, 2], [2, 2]]})
    served.step(6)
    api("PATCH", "/api/objects/chair-1", {"x_m": 0.0, "y_m": -3.0})
    served.step(20)
    events = api.get("/api/events")
    conforms("/api/events", "GET", 200, events)
    assert [(one["event_type"], one["id"], one["zone_name"]) for one in events] == [("left", "chair-1", "corner")]


def test_the_pose_and_the_dock_are_set(robot):
    served, api = robot
    status, _, dock = api("PUT", "/api/dock", {})
    conforms("/api/dock", "PUT", status, dock)
    assert dock["x_m"] == pytest.approx(0.55)
    assert api.get("/api/map")["dock"] == api.get("/api/dock") == dock
    status, _, pose = api("PUT", "/api/pose", {"x_m": -2.0, "y_m": 1.0, "yaw_rad": 0.0, "sigma_m": 0.2})
    conforms("/api/pose", "PUT", status, pose)
    served.step()
    now = api.get("/api/pose")
    assert (now["x_m"], now["y_m"]) == (pytest.approx(-1.95, abs=0.1), pytest.approx(1.0, abs=0.1))
    place = {"x_m": 1.0, "y_m": 2.0, "yaw_rad": 3.0}
    assert api("PUT", "/api/dock", place)[2] == api.get("/api/dock") == api("PUT", "/api/pose", {"in_dock": True})[2]
    served.step()
    now = api.get("/api/pose")
    assert (now["x_m"], now["y_m"]) == (pytest.approx(1.0, abs=0.1), pytest.approx(2.0, abs=0.1))
    assert api("DELETE", "/api/dock")[0] == 200
    assert "dock" not in api.get("/api/map")


def test_a_place_to_approach_an_object_from(robot):
    """The chair stands at (3, 1), the robot at (0.55, 0): it is approached from this side, 0.4 m before its edge."""
    served, api = robot
    place = api.get("/api/objects/chair-1/approach")
    conforms("/api/objects/{id}/approach", "GET", 200, place)
    chair = api.get("/api/objects/chair-1")
    away = np.array([place["x_m"] - chair["x_m"], place["y_m"] - chair["y_m"]])
    assert np.linalg.norm(away) == pytest.approx(chair["radius_m"] + 0.4 + 0.25, abs=0.01)
    assert np.arctan2(-away[1], -away[0]) == pytest.approx(place["yaw_rad"], abs=0.01)  # it faces the chair
    assert away[0] < 0  # from the robot's side
    assert place["floor"] == "unknown"
    assert api("GET", "/api/objects/chair-1/approach?standoff_m=-1")[0] == 400
    assert api("GET", "/api/objects/chair-9/approach")[0] == 404
    status, _, body = api("POST", "/api/objects/chair-1/go", {})
    assert (status, "run with --ros2" in body["error"]) == (409, True)
    went = []
    served.page.goals.append(went.append)
    assert api("POST", "/api/objects/chair-1/go", {})[2] == place
    assert went[0].vector() == pytest.approx([place["x_m"], place["y_m"], place["yaw_rad"]], abs=1e-3)


def test_edits_that_cannot_be_are_refused_in_one_line(robot):
    served, api = robot
    square = [[0, 0], [1, 0], [1, 1]]
    wrong = [
        ("PATCH", "/api/objects/chair-1", {"name": "x" * 81}, 400),
        ("PATCH", "/api/objects/chair-1", {"name": "line\nbreak"}, 400),
        ("PATCH", "/api/objects/chair-1", {"name": "a\u202eb"}, 400),
        ("PATCH", "/api/objects/chair-1", {"name": " "}, 409),
        ("PATCH", "/api/objects/chair-1", {"nome": "x"}, 400),
        ("PATCH", "/api/objects/chair-9", {"name": "x"}, 404),
        ("DELETE", "/api/objects/chair-9", None, 404),
        ("POST", "/api/objects/chair-1/merge", {"into": "chair-1"}, 409),
        ("POST", "/api/objects/chair-1/merge", {"into": "chair-9"}, 404),
        ("POST", "/api/objects/chair-1/restore", {}, 409),
        ("POST", "/api/zones", {"name": "", "corners_m": square}, 409),
        ("POST", "/api/zones", {"name": "line", "corners_m": [[0, 0], [1, 1], [2, 2]]}, 409),
        ("POST", "/api/zones", {"name": "two", "corners_m": square[:2]}, 400),
        ("POST", "/api/zones", {"name": "far", "corners_m": [[0, 0], [1e9, 0], [1, 1]]}, 400),
        ("POST", "/api/zones", {"name": "many", "corners_m": [[k, k * k] for k in range(101)]}, 400),
        ("PATCH", "/api/objects/chair-1", {"x_m": 1.0}, 400),
        ("PATCH", "/api/objects/chair-1", {"width_m": 0.0}, 400),
        ("PATCH", "/api/objects/chair-1", {"label": ""}, 400),
        ("PATCH", "/api/objects/chair-1", {"label": "line\nbreak"}, 409),
        ("POST", "/api/objects", {"label": "chair", "x_m": 1.0}, 400),
        ("POST", "/api/objects", {"label": "chair", "x_m": 1.0, "y_m": 0.0, "width_m": 0.5}, 400),
        ("GET", "/api/objects/chair-1/merge?into=chair-9", None, 404),
        ("GET", "/api/objects/chair-1/merge?into=chair-1", None, 409),
        ("PUT", "/api/pose", {"x_m": 1.0, "y_m": 0.0}, 400),
        ("PUT", "/api/pose", {"in_dock": True}, 409),
        ("PUT", "/api/pose", {"x_m": 1.0, "y_m": 0.0, "yaw_rad": 0.0, "sigma_m": 0.0}, 400),
        ("PUT", "/api/dock", {"x_m": 1.0}, 400),
        ("GET", "/api/dock", None, 404),
        ("DELETE", "/api/dock", None, 404),
        ("PUT", "/api/zones/zone-9", {"name": "none", "corners_m": square}, 404),
        ("DELETE", "/api/zones/zone-9", None, 404),
    ]
    before = served.page.map_text()
    for method, path, body, expected in wrong:
        status, _, items = api(method, path, body)
        assert status == expected, (method, path, body, items)
        assert "\n" not in items["error"]
    assert served.page.map_text() == before


def test_an_edit_that_the_run_does_not_take_is_withdrawn(serve, monkeypatch):
    monkeypatch.setattr("edgemap.view.questions.EDIT_LIMIT_S", 0.05)
    served = serve(steps=12)
    with served.stepping:  # the run is busy in a step
        status, _, body = Api(served.port)("PATCH", "/api/objects/chair-1", {"name": "late"})
    assert (status, "withdrawn" in body["error"]) == (503, True)
    served.step()
    assert "late" not in served.page.map_text()


def test_a_body_that_never_comes_is_not_waited_for(serve, monkeypatch):
    monkeypatch.setattr(questions, "BODY_LIMIT_S", 0.05)
    served = serve()
    with socket.create_connection(("127.0.0.1", served.port), timeout=60) as rude:
        head = f"POST /api/save HTTP/1.1\r\nHost: 127.0.0.1:{served.port}\r\nContent-Type: application/json\r\n"
        rude.sendall(head.encode() + b"Content-Length: 9\r\n\r\n{")
        assert rude.recv(100).startswith(b"HTTP/1.1 408")


def test_an_agents_server_asks_a_run(robot):
    served, _ = robot
    source = open_source(served.url)
    source.mark("chair-1", {"name": "mine", "confirmed": True})
    objects, annotations = source.read()
    chair = next(item for item in objects if item.id == "chair-1")
    assert (chair.name, [event.what for event in chair.history]) == ("mine", ["appeared", "named", "confirmed"])
    assert annotations.identity == served.page.annotations.identity
    assert source.approach(chair, objects)["object"] == "chair-1"
    for ask in (lambda: source.mark("tv-9", {"name": "x"}), lambda: source.picture("chair-1")):
        with pytest.raises(MapError, match=r"no object 'tv-9'|no picture of chair-1"):
            ask()
    with pytest.raises(MapError, match="no run answers"):
        open_source("http://127.0.0.1:9")
