"""`--mqtt`: the map's state and events to an MQTT broker, with Home Assistant's discovery."""

import json
import math
import os
import re
import threading
from base64 import b64encode
from concurrent.futures import Future
from contextlib import suppress
from typing import Any

from edgemap.bridges.mqtt.home_assistant import config_topic, discovery, zone_discovery
from edgemap.bridges.mqtt.picture import MapPicture
from edgemap.geometry.map_object import MapEvent, MapObject
from edgemap.geometry.objects.annotations import MapIdentity
from edgemap.geometry.objects.events import Edit
from edgemap.geometry.objects.queries import inside_polygon
from edgemap.geometry.objects.scale import scaled_map
from edgemap.geometry.objects.zone_watch import ZoneWatch
from edgemap.runtime.frames.errors import BridgeError
from edgemap.runtime.frames.extras import need
from edgemap.runtime.frames.faults import Fault
from edgemap.runtime.frames.limits import EVERY_S, PATIENCE_S, SELDOM_S
from edgemap.runtime.frames.option_texts import host_and_port
from edgemap.runtime.frames.timing import StreamTimer
from edgemap.runtime.outputs.sinks.kinds import RunInfo
from edgemap.runtime.step.map_file import event_record, object_record, object_uuid, save_map
from edgemap.runtime.step.map_memory import MOVED_M
from edgemap.runtime.step.slam import StepResult
from edgemap.runtime.step.wall_clock import utc_text

QUEUED = 1000  # messages kept for a broker that does not take them
REMEMBERED = ("objects", "zones")  # retained topics that an earlier run may have left
PACKET_BYTES = 1 << 18  # of one packet from the broker: more than any object's
NO_IDENTITY = MapIdentity("map")


class MqttPublisher:
    """A sink that keeps a broker up to date; all topics start with `edgemap/ROBOT/`, all payloads are JSON but status.

    status: `online` or `offline`, retained; the last will. state: pose, frames, number of objects and the last fault,
    retained. objects/ID: each object as in map.json, retained, and cleared when the object is removed. events:
    `event_type` appeared, vanished or an entry of its history with the object; `into` where it became part of another
    one; entered and left with the zone. A second broker connection with the same robot's name replaces this one. A
    separate thread sends and reconnects; after an outage the broker gets all retained messages again and the events
    since then as one step.
    Raises MissingExtraError. `write` raises BridgeError while there is no connection.
    """

    def __init__(
        self, host: str, port: int, run: RunInfo, user: str | None = None, password: str | None = None
    ) -> None:
        """run: its folder is where `save` writes, its edits take `in dock`."""
        need("mqtt", "--mqtt")
        from paho.mqtt.client import Client
        from paho.mqtt.enums import CallbackAPIVersion

        class BoundedClient(Client):
            def _sock_recv(self, bufsize: int) -> bytes:
                """bufsize: what is left of a packet. One that is too large ends the connection before it is read."""
                if bufsize > PACKET_BYTES:
                    raise ConnectionError(f"a packet of {bufsize} bytes")
                return super()._sock_recv(bufsize)

        self.name, self.root = "MQTT", f"edgemap/{topic_level(run.robot)}"
        self._address, self._run = f"{host}:{port}", run
        self._published: dict[str, MapObject] = {}
        self._identity = NO_IDENTITY
        self._asked: Future[str] | None = None  # the newest edit, until it is taken or refused
        self._zones, self._zone_topics = ZoneWatch(), set[str]()
        self._picture = MapPicture(lambda data: self._retain(f"{self.root}/map", b64encode(data)))
        self._picture_timer = StreamTimer(SELDOM_S)
        self._save_timer, self._save_asked = StreamTimer(SELDOM_S), threading.Event()  # of maps that commands ask for
        self._fault, self._faults, self._state_timer = "", 0, StreamTimer(EVERY_S)
        self._state: dict[str, Any] = {}  # the newest
        self._connected, self._refused = threading.Event(), "no answer"
        self._new_connection = False
        self._retained, self._retaining = dict[str, str | bytes](), threading.Lock()  # what the broker keeps, by topic
        self._client = BoundedClient(CallbackAPIVersion.VERSION2, client_id=f"edgemap-{topic_level(run.robot)}")
        self._cleaned = self._cleaning = False  # of objects of an earlier run
        self._client.suppress_exceptions = True  # a message that a callback cannot read does not end the thread
        self._client.max_queued_messages_set(QUEUED)
        self._client.max_inflight_messages_set(QUEUED)
        self._client.reconnect_delay_set(max_delay=30)  # seconds
        if user:
            self._client.username_pw_set(user, password)
        self._client.will_set(f"{self.root}/status", "offline", qos=1, retain=True)
        self._client.on_connect, self._client.on_disconnect = self._on_connect, self._on_disconnect
        self._client.on_message = self._on_message
        self._client.on_connect_fail = self._on_connect_fail
        try:
            self._client.connect_async(host, port, keepalive=15)
        except ValueError as error:
            raise BridgeError(f"--mqtt {host}:{port}: {error}") from None
        self._client.loop_start()
        self._connected.wait(PATIENCE_S)

    def write(self, result: StepResult, objects: list[MapObject]) -> None:
        """Publishes the changes."""
        if self._client.loop_start() == 0:  # it is running already, but where its thread ended
            self._connected.clear()
        if not self._connected.is_set():
            raise BridgeError(f"no broker at {self._address} ({self._refused})")
        if self._new_connection:
            self._new_connection = False
            self._begin()
        known, at = {item.id: item for item in objects}, {"at": utc_text(result.at)}
        self._identity = result.annotations.identity or NO_IDENTITY
        for identity, item in known.items():
            before = self._published.get(identity)
            if before is None or _has_changed(before, item):
                self._published[identity] = item
                record = object_record(item) | {"uuid": object_uuid(identity, self._identity.map_id)}
                self._retain(self._topic_of(item), json.dumps(record))
            if before is None:
                self._event("appeared", item, at)
            for event in _news(before, item):
                self._event(event.what, item, event_record(event))
        for identity in [one for one in self._published if one not in known]:
            item, into = self._published.pop(identity), result.merged.get(identity)
            self._retain(self._topic_of(item), "")
            self._event("vanished", item, at | ({"into": into} if into else {}))
        stamp_s = result.frame.stamp_s
        for event in self._zones.update(objects, result.annotations.zones, stamp_s):
            self._publish("events", json.dumps(event.record()))
        if self._state_timer.due(stamp_s):
            self._publish_state(result, objects)
            self._publish_zones(result, objects)
        if self._picture_timer.due(stamp_s):
            self._picture.draw(result, objects)
        if self._save_asked.is_set() and self._save_timer.due(stamp_s):
            self._save_asked.clear()
            self._save(result, objects)
        if self._asked is not None and self._asked.done():
            asked, self._asked = self._asked, None
            if (refusal := asked.exception()) is not None:
                raise BridgeError(f"in dock: {refusal}")

    last = write

    def fault(self, fault: Fault) -> None:
        """In the state at once: while the camera is away no step brings one."""
        self._fault, self._faults = fault.text, self._faults + 1
        if self._state and self._connected.is_set():
            self._send_state()

    def close(self) -> None:
        """Publishes that the robot is offline; its state and objects stay retained. May be called twice."""
        if self._connected.is_set():
            with suppress(ValueError, RuntimeError):  # a broker that takes nothing: the queue is full
                self._client.publish(f"{self.root}/status", "offline", 1, retain=True).wait_for_publish(PATIENCE_S)
        self._picture.close()
        self._client.disconnect()
        self._client.loop_stop()

    def _begin(self) -> None:
        """A new connection: all retained messages again. Objects of an earlier run answer to `_on_message`."""
        with self._retaining:
            self._retained |= discovery(self._run.robot, self.root) | {f"{self.root}/status": "online"}
            for topic, payload in self._retained.items():
                self._client.publish(topic, payload, qos=1, retain=True)
        self._client.subscribe(f"{self.root}/command", qos=1)
        if not self._cleaned:
            self._client.subscribe([(f"{self.root}/{kind}/+", 1) for kind in REMEMBERED])
            self._cleaned = self._cleaning = True
        self._state_timer.done()

    def _event(self, kind: str, item: MapObject, more: dict[str, Any]) -> None:
        record = {key: value for key, value in object_record(item).items() if key in ("id", "label", "x_m", "y_m")}
        record |= {"uuid": object_uuid(item.id, self._identity.map_id), "event_type": kind}
        self._publish("events", json.dumps(record | more))

    def _topic_of(self, item: MapObject) -> str:
        return f"{self.root}/objects/{topic_level(item.id)}"

    def _publish_state(self, result: StepResult, objects: list[MapObject]) -> None:
        if self._cleaning and self._state:
            self._client.unsubscribe([f"{self.root}/{kind}/+" for kind in REMEMBERED])
            self._cleaning = False
        pose = result.pose_map_base
        self._state = {
            "stamp_s": round(result.frame.stamp_s, 3),
            "frames": result.frame.index + 1,
            "x_m": round(pose.x_m, 3),
            "y_m": round(pose.y_m, 3),
            "yaw_rad": round(pose.yaw_rad, 4),
            "room": self._picture.room(pose),
            "objects": len(objects),
            "map_id": self._identity.map_id,
            "verdict": self._run.verdict().document(),
        }
        self._send_state()

    def _send_state(self) -> None:
        state = self._state | {"camera": str(self._run.camera.state), "fault_count": self._faults, "fault": self._fault}
        self._retain(f"{self.root}/state", json.dumps(state))

    def _publish_zones(self, result: StepResult, objects: list[MapObject]) -> None:
        """What is in each zone; a zone that is gone leaves Home Assistant."""
        now: dict[str, str] = {}
        for zone in result.annotations.zones:
            identity = topic_level(zone.id)
            held = [one.name or one.id for one in inside_polygon(objects, zone.corners_m)]
            state = {"name": zone.name, "occupied_by": held, "count": len(held)}
            now |= [zone_discovery(self._run.robot, self.root, identity, zone.name)]
            now[f"{self.root}/zones/{identity}"] = json.dumps(state)
        for topic, payload in (dict.fromkeys(self._zone_topics - now.keys(), "") | now).items():
            self._retain(topic, payload)
        self._zone_topics = set(now)

    def _save(self, result: StepResult, objects: list[MapObject]) -> None:
        """Writes the map to a file of its own in the run folder. Raises MapError."""
        annotations = self._run.verdict().on(result.annotations)
        path = self._run.folder / f"map-{result.frame.index:06d}.json"
        save_map(path, *scaled_map(objects, annotations, result.grid, result.scale))

    def _publish(self, topic: str, payload: str) -> None:
        self._client.publish(f"{self.root}/{topic}", payload, qos=1)

    def _retain(self, topic: str, payload: str | bytes) -> None:
        """Publishes what the broker keeps under a whole topic, where that has changed; empty: no longer."""
        with self._retaining:
            if self._retained.get(topic, "") != payload:
                self._retained[topic] = payload
                if not payload:
                    del self._retained[topic]
                self._client.publish(topic, payload, qos=1, retain=True)

    # On the client's thread.

    def _on_connect(self, client: Any, userdata: Any, flags: Any, reason: Any, properties: Any) -> None:  # noqa: ARG002
        if reason.is_failure:
            self._refused = str(reason)
            return
        self._new_connection = True
        self._connected.set()

    def _on_disconnect(self, client: Any, userdata: Any, flags: Any, reason: Any, properties: Any) -> None:  # noqa: ARG002
        self._refused = str(reason)
        self._connected.clear()

    def _on_connect_fail(self, client: Any, userdata: Any) -> None:  # noqa: ARG002
        self._refused = "cannot be reached"

    def _on_message(self, client: Any, userdata: Any, message: Any) -> None:  # noqa: ARG002
        """A command; or what an earlier run has left at the broker, removed unless this run has published it."""
        if message.topic == f"{self.root}/command":
            if message.payload == b"save" and not message.retain:
                self._save_asked.set()
            if message.payload == b"in dock" and not message.retain:
                self._asked = self._run.edits.submit(Edit("pose", "dock"))
            return
        kind, _, identity = message.topic.removeprefix(f"{self.root}/").partition("/")
        with self._retaining:
            if kind in REMEMBERED and message.retain and message.payload and message.topic not in self._retained:
                client.publish(message.topic, "", qos=1, retain=True)
                if kind == "zones":
                    client.publish(config_topic(self._run.robot, "sensor", identity), "", qos=1, retain=True)


def _has_changed(before: MapObject, item: MapObject) -> bool:
    """Whether a person has edited an object, or its history or place is another."""
    new, old = ((one.label, one.name, one.confirmed, one.corrected, one.history) for one in (item, before))
    return new != old or math.dist(before.position_m, item.position_m) > MOVED_M


def _news(before: MapObject | None, item: MapObject) -> list[MapEvent]:
    """New entries of an object's history, but for `appeared`. The first time that an object is published, its history
    is old, but for a move by which it got its id."""
    if before is None:
        return [event for event in item.history[-1:] if event.what == "moved" and event.other and not item.earlier]
    published = {(event.what, event.other, event.to_m) for event in before.history}
    again = before.earlier and not item.earlier  # of `restored` the history keeps the latest
    return [
        event for event in item.history if event.what != "appeared"
        and ((event.what, event.other, event.to_m) not in published or (again and event.what == "restored"))
    ]  # fmt: skip


def topic_level(name: str) -> str:
    """A name as one level of an MQTT topic: without its separator, wildcards and control characters."""
    return re.sub(r"[+#/\x00-\x1f$]", "_", name) or "_"


def open(address: str, run: RunInfo) -> MqttPublisher:
    """The sink of `--mqtt HOST[:PORT]`; user and password are in EDGEMAP_MQTT_USER and EDGEMAP_MQTT_PASSWORD.

    Raises UsageError, or as the publisher does.
    """
    user, password = (os.environ.get(f"EDGEMAP_MQTT_{name}") for name in ("USER", "PASSWORD"))
    return MqttPublisher(*host_and_port(address, "--mqtt", 1883), run, user, password)
