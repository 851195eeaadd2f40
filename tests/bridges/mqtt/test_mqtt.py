"""What a real broker (mosquitto) and its own client see of a run."""

import json
import socket
import subprocess
import sys
import threading
import time
from contextlib import closing, nullcontext, suppress
from dataclasses import replace

import cv2
import numpy as np
import pytest
from support.broker import MISSING, Broker
from support.faults import made
from support.results import run_info
from support.steps import Steps
from support.waiting import wait_for

from edgemap.geometry.map_object import MapEvent
from edgemap.geometry.objects.annotations import Zone
from edgemap.geometry.objects.events import Edit
from edgemap.runtime.frames.errors import BridgeError
from edgemap.runtime.frames.version import VERSION
from edgemap.runtime.step.mapper import Mapper

pytest.importorskip("paho.mqtt")
LACKS = f"not here: {', '.join(MISSING)} (apt install mosquitto …-clients)"
pytestmark = pytest.mark.skipif(bool(MISSING), reason=LACKS)

from edgemap.bridges.mqtt.picture import MapPicture  # noqa: E402
from edgemap.bridges.mqtt.sink import MqttPublisher, topic_level  # noqa: E402


@pytest.fixture
def broker(tmp_path):
    server = Broker(tmp_path)
    yield server
    server.stop()


def two_objects():
    """A step and the two objects on the map after it."""
    steps = Steps()
    return next((result, objects) for result, objects in iter(steps.next, None) if len(objects) == 2)


STATE = "edgemap/robo/state"


def objects_in(told):
    """The topics of objects."""
    return {topic for topic in told if topic.startswith("edgemap/robo/objects/")}


def publisher(broker, robot="robo"):
    return closing(MqttPublisher("127.0.0.1", broker.port, run_info(robot)))


def test_a_newcomer_is_told_state_objects_and_the_device(broker):
    steps = Steps()
    with publisher(broker) as sink:
        sink.fault(made("wheels: silent for 1.2 s"))
        steps.into(sink, 11)
        _, objects = steps.next()
        told = broker.retained(until=lambda told: json.loads(told.get(STATE, '{"frames": 0}'))["frames"] == 11)
    assert told["edgemap/robo/status"] == "online"
    state = json.loads(told["edgemap/robo/state"])
    assert (state["objects"], state["frames"], state["fault"]) == (2, 11, "wheels: silent for 1.2 s")
    assert state["x_m"] == pytest.approx(0.5)
    for item in objects:
        record = json.loads(told[f"edgemap/robo/objects/{item.id}"])
        assert (record["id"], record["label"]) == (item.id, item.label)
        assert [record["x_m"], record["y_m"]] == pytest.approx(item.position_m.tolist(), abs=0.25)
    entities = {topic: json.loads(text) for topic, text in told.items() if topic.startswith("homeassistant/")}
    kinds = {
        "changes": "event", "picture": "image", "save": "button", "relocalise": "button", "camera": "binary_sensor",
    }  # fmt: skip
    kinds["unreliable"] = "binary_sensor"
    kinds |= dict.fromkeys(("fault", "heading", "objects", "room", "x", "y"), "sensor")
    assert entities.keys() == {f"homeassistant/{kind}/edgemap-robo/{name}/config" for name, kind in kinds.items()}
    device = {"identifiers": ["edgemap-robo"], "name": "robo", "manufacturer": "edgemap", "sw_version": VERSION}
    assert all(entity["device"] == device for entity in entities.values())
    assert {(one["~"], one["availability_topic"]) for one in entities.values()} == {("edgemap/robo", "~/status")}
    topics = {value for entity in entities.values() for key, value in entity.items() if key.endswith("_topic")}
    assert topics == {f"~/{name}" for name in ("status", "state", "events", "map", "command")}
    assert len({entity["unique_id"] for entity in entities.values()}) == len(kinds)
    status = "edgemap/robo/status"
    assert broker.retained(status, lambda told: told[status] == "offline") == {status: "offline"}  # closed by now
    assert f"edgemap/robo/objects/{objects[0].id}" in broker.retained()  # the map stays known


def test_zones_the_camera_the_room_and_a_saved_map(broker, tmp_path):
    """A zone says what is in it and leaves with its entity; the commands write the map and edit the pose."""
    result, objects = two_objects()
    x_m, y_m = objects[0].position_m.tolist()
    around = ((-0.2, -0.2), (0.2, -0.2), (0.2, 0.2), (-0.2, 0.2))
    zone = Zone("zone-1", "corner", tuple((x_m + dx, y_m + dy) for dx, dy in around))
    zoned = replace(result, annotations=replace(result.annotations, zones=(zone,)))
    config, run = "homeassistant/sensor/edgemap-robo/zone-1/config", run_info(folder=tmp_path)
    with closing(MqttPublisher("127.0.0.1", broker.port, run)) as sink:
        sink.write(zoned, objects)
        sent = broker.retained(until=lambda sent: "edgemap/robo/zones/zone-1" in sent and "edgemap/robo/map" in sent)
        occupied = {"name": "corner", "occupied_by": [objects[0].id], "count": 1}
        assert json.loads(sent["edgemap/robo/zones/zone-1"]) == occupied
        assert json.loads(sent[config])["name"] == "corner"
        entity = json.loads(sent["homeassistant/button/edgemap-robo/relocalise/config"])
        assert (json.loads(sent[STATE])["camera"], json.loads(sent[STATE])["room"]) == ("running", None)
        run.camera.state = "lost"
        sink.fault(made("camera x: lost"))
        broker.retained(STATE, lambda sent: json.loads(sent[STATE])["camera"] == "lost")
        broker.publish("edgemap/robo/command", "save")
        later = replace(result, frame=replace(result.frame, stamp_s=result.frame.stamp_s + 2.0))
        wait_for(lambda: sink.write(later, objects) or [*tmp_path.glob("map-*.json")], "a saved map")
        sink._save_asked.set()  # again, in the next step
        sink.write(replace(later, frame=replace(later.frame, index=9)), objects)
        sent = broker.retained(until=lambda sent: config not in sent)
        mapper = Mapper()
        for dock in ("dock", ""):  # without one, and with one
            broker.publish("edgemap/robo/command", entity["payload_press"])
            wait_for(lambda: run.edits._waiting, "the command")
            run.edits.apply(mapper, 0)
            with pytest.raises(BridgeError, match="no dock") if dock else nullcontext():
                sink.write(later, objects)
            mapper.edit(Edit("dock", pose=(1.0, 2.0, 0.5)))
    assert mapper.pose_map_base.vector().tolist() == [1.0, 2.0, 0.5]
    assert config not in sent
    assert "edgemap/robo/zones/zone-1" not in sent
    (saved,) = [json.loads(path.read_text()) for path in tmp_path.glob("map-*.json")]
    assert [one["id"] for one in saved["objects"]] == [item.id for item in objects]


def test_the_picture_has_nothing_of_the_camera(broker):
    """Two runs whose pictures differ in every pixel send the same bytes."""
    result, objects = two_objects()
    sent = []
    for value in (0, 255):
        frame = replace(result.frame, image=np.full_like(result.frame.image, value))
        with publisher(broker) as sink:
            drawn = []
            sink._picture.send = drawn.append
            sink.write(replace(result, frame=frame, pictured=frame), objects)
            wait_for(lambda: drawn, "a picture")  # noqa: B023
            sent += drawn
    assert sent[0] == sent[1]
    picture = cv2.imdecode(np.frombuffer(sent[0], np.uint8), cv2.IMREAD_COLOR)
    assert picture.std() > 1.0


def test_a_picture_that_cannot_be_drawn_is_told_with_the_next_one():
    def refused(data):
        raise RuntimeError("no room on the disk")

    (result, objects), picture = two_objects(), MapPicture(refused)
    picture.draw(result, objects)
    wait_for(picture._drawing.done, "the drawing")
    with pytest.raises(RuntimeError, match="no room"):
        picture.draw(result, objects)
    picture.draw(result, objects)
    picture.close()


def test_objects_appear_move_and_vanish(broker):
    result, objects = two_objects()
    chair, couch = sorted(objects, key=lambda item: item.label)
    better = replace(chair, position_m=chair.position_m + [0.3, 0.0])  # an estimate, and no news
    moved = replace(better, history=(MapEvent("moved", 1.8e9, from_m=chair.place_m, to_m=better.place_m),))
    later = replace(couch, id="couch-9", history=(MapEvent("moved", 1.8e9, to_m=couch.place_m, other="couch-1"),))
    listener = broker.listen("edgemap/robo/events")
    with publisher(broker) as sink:
        sink.write(result, [chair, couch])
        sink.write(result, [better, couch])
        sink.write(result, [moved, couch])
        result = replace(result, merged={couch.id: moved.id})
        sink.write(result, [moved, later])
        sink.write(result, [])
        events = [json.loads(listener.stdout.readline().split("\t")[1]) for _ in range(8)]
        assert not objects_in(broker.retained(until=lambda told: not objects_in(told)))
    listener.kill()
    listener.communicate()
    assert [(event.pop("event_type"), event.pop("id"), event.get("into")) for event in events] == [
        ("appeared", chair.id, None),
        ("appeared", couch.id, None),
        ("moved", chair.id, None),
        ("appeared", later.id, None),
        ("moved", later.id, None),
        ("vanished", couch.id, chair.id),
        ("vanished", chair.id, None),
        ("vanished", later.id, None),
    ]
    assert (events[2]["to_m"], events[4]["other"]) == (pytest.approx(better.place_m), "couch-1")
    np.testing.assert_allclose([events[2]["x_m"], events[2]["y_m"]], moved.position_m, atol=1e-6)


def test_a_name_a_confirmation_and_a_fault_are_published_at_once(broker):
    """A name came when the object moved, and a camera that was away was reported when it was back."""
    result, objects = two_objects()
    first = objects[0].id
    topic = f"edgemap/robo/objects/{first}"
    with publisher(broker) as sink:
        sink.write(result, objects)
        named = [replace(item, name="Ecke", confirmed=True) if item.id == first else item for item in objects]
        sink.write(result, named)
        sink.fault(made("camera x: stopped delivering"))
        told = broker.retained(until=lambda told: "stopped" in told.get(STATE, "") and "Ecke" in told.get(topic, ""))
    state = json.loads(told[STATE])
    assert (state["fault"], state["fault_count"], state["objects"]) == ("camera x: stopped delivering", 1, 2)
    assert json.loads(told[topic])["confirmed"]


def test_a_broker_that_goes_away_is_a_failure_and_gets_everything_when_it_is_back(broker):
    steps = Steps()
    with publisher(broker) as sink:
        steps.into(sink, 3)
        broker.stop()
        with pytest.raises(BridgeError, match=rf"^no broker at 127\.0\.0\.1:{broker.port} \("):  # noqa: PT012
            while True:  # until it has noticed
                steps.into(sink)
                time.sleep(0.05)
        broker.start()
        wait_for(lambda: steps.taken_by(sink), "the broker")
        told = broker.retained(until=lambda told: told.get("edgemap/robo/status") == "online" and objects_in(told))
    assert told["edgemap/robo/status"] == "online"
    assert len(objects_in(told)) == 2
    assert "homeassistant/event/edgemap-robo/changes/config" in told


def test_no_broker_at_all_does_not_keep_a_run_from_starting(broker):
    broker.stop()
    with publisher(broker) as sink, pytest.raises(BridgeError, match=r"no broker at .* \(cannot be reached\)"):
        Steps().into(sink)


def test_objects_of_an_earlier_run_leave_the_broker(broker):
    result, objects = two_objects()
    with publisher(broker) as sink:
        sink.write(result, [replace(objects[0], id="chair-7"), objects[1]])
    with publisher(broker) as sink:
        sink.write(result, objects)
        wanted = {f"edgemap/robo/objects/{item.id}" for item in objects}
        told = objects_in(broker.retained(until=lambda told: objects_in(told) == wanted))
    assert told == wanted


def test_a_killed_robot_is_offline(broker):
    program = (
        "from edgemap.bridges.mqtt.sink import MqttPublisher; from support.steps import Steps;"
        "from support.results import run_info;"
        f"sink = MqttPublisher('127.0.0.1', {broker.port}, run_info()); Steps().into(sink, 2);"
        "import time; time.sleep(600)"
    )
    listener = broker.listen("edgemap/robo/status")
    environment = {"PYTHONPATH": ":".join(path for path in sys.path if path)}
    with subprocess.Popen([sys.executable, "-c", program], env=environment) as robot:
        assert listener.stdout.readline().strip().split("\t")[1] == "online"
        robot.kill()
    assert listener.stdout.readline().strip().split("\t")[1] == "offline"
    listener.kill()
    listener.communicate()


def test_names_are_one_level_of_a_topic():
    assert topic_level("potted plant-1") == "potted plant-1"
    assert topic_level("a/b+#$c\n") == "a_b___c_"


def test_a_broker_that_takes_nothing_does_not_keep_a_run_from_ending(monkeypatch):
    """It accepts the connection and then never answers: messages wait, and some find the queue full."""
    monkeypatch.setattr("edgemap.bridges.mqtt.sink.QUEUED", 5)
    with socket.create_server(("127.0.0.1", 0)) as listening:

        def accept():
            connection, _ = listening.accept()
            with connection:
                connection.recv(4096)
                connection.sendall(b"\x20\x02\x00\x00")  # accepted
                while connection.recv(65536):
                    pass

        answering = threading.Thread(target=accept, daemon=True)
        answering.start()
        sink = MqttPublisher("127.0.0.1", listening.getsockname()[1], run_info())
        Steps().into(sink, 60)
        sink.close()
        answering.join(10.0)


NO_UTF_8, OF_256_MB = b"\x31\x05\x00\x02\xff\xfex", b"\x31\xff\xff\xff\x7f" + bytes(100)


@pytest.mark.parametrize(("packet", "stays"), [(NO_UTF_8, True), (OF_256_MB, False)], ids=["no UTF-8", "256 MB"])
def test_a_brokers_message_never_ends_what_is_sent(packet, stays):
    """stays: whether the connection does; a new one sends on where it does not."""
    with socket.create_server(("127.0.0.1", 0)) as listening:
        sink, steps = MqttPublisher("127.0.0.1", listening.getsockname()[1], run_info()), Steps()

        def accepted():
            connection, _ = listening.accept()
            connection.settimeout(10.0)
            connection.sendall(b"\x20\x02\x00\x00")
            wait_for(lambda: steps.taken_by(sink), "the connection")
            return connection

        with closing(sink), accepted() as connection:
            connection.sendall(packet)
            if not stays:
                with suppress(ConnectionResetError):
                    while connection.recv(65536):
                        pass
                connection = accepted()
            time.sleep(0.2)
            assert [thread for thread in threading.enumerate() if thread.name.startswith("paho-mqtt")]
            sink.fault(made("after it"))
            heard = b""
            while b"after it" not in heard:
                heard += connection.recv(65536)
            connection.close()
