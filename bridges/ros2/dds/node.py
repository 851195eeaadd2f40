"""One DDS participant that publishes and subscribes as a ROS 2 node does."""

import os
import time
from collections.abc import Callable, Iterator
from enum import StrEnum
from functools import cache
from typing import Any, TypeVar

from edgemap.bridges.ros2.dds.discovery import Discovery, discovery_from
from edgemap.bridges.ros2.dds.types import dds_topic, dds_type, ros_kind, sample_type
from edgemap.bridges.ros2.messages.definitions import DAMAGE, HASHES, Message, decoder, encoder
from edgemap.runtime.frames.errors import BridgeError
from edgemap.runtime.frames.extras import need

Answer = TypeVar("Answer")
BLOCK_MS = 5  # a reliable writer waits this long for slow readers, then drops the message


class Reliability(StrEnum):
    """reliable: missing samples are sent again. best_effort: they are not. latched: reliable, kept for late readers."""

    RELIABLE = "reliable"
    BEST_EFFORT = "best_effort"
    LATCHED = "latched"


class Publisher:
    """Publishes one topic (`/tf`) of a type (`tf2_msgs/msg/TFMessage`)."""

    def __init__(
        self, node: "Node", topic: str, kind: str, reliability: Reliability = Reliability.RELIABLE, depth: int = 10
    ) -> None:
        from cyclonedds.core import Listener
        from cyclonedds.pub import DataWriter

        self.latched = reliability is Reliability.LATCHED
        self._kind = kind
        self._encode = encoder(kind)
        self._sample = sample_type(kind)
        self._readers = readers = [0]
        # A thread of Cyclone DDS calls it. It must not refer to this object, which would then never be freed.
        listener = Listener(on_publication_matched=lambda _, status: readers.__setitem__(0, status.current_count))
        made = _topic(node.participant, topic, kind)
        self._writer: Any = DataWriter(node.participant, made, _qos(kind, reliability, depth), listener)

    @property
    def wanted(self) -> bool:
        """Whether the topic has a reader, or is latched for later readers."""
        return self.latched or self._readers[0] > 0

    def write(self, message: Message) -> None:
        """Publishes a message. A message that slow readers cannot accept is dropped. Raises BridgeError."""
        from cyclonedds.core import DDSException

        try:
            self._writer.write(self._sample(self._encode(message)))
        except DDSException as error:
            if error.code != DDSException.DDS_RETCODE_TIMEOUT:
                raise BridgeError(f"ROS 2: {self._kind} cannot be published ({error.msg})") from None


class Subscription:
    """Reads one topic on demand, without a thread. Best effort matches every publisher. depth: maximum number of unread
    messages."""

    def __init__(
        self, node: "Node", topic: str, kind: str, reliability: Reliability = Reliability.BEST_EFFORT, depth: int = 10
    ) -> None:
        from cyclonedds.core import InstanceState, ReadCondition, SampleState, ViewState, WaitSet
        from cyclonedds.sub import DataReader

        self.topic = topic
        self._decode = decoder(kind)
        made = _topic(node.participant, topic, kind)
        self._reader: Any = DataReader(node.participant, made, _qos(kind, reliability, depth))
        self._depth = depth
        self._any = ReadCondition(self._reader, SampleState.NotRead | ViewState.Any | InstanceState.Any)
        self._waits: Any = WaitSet(node.participant)
        self._waits.attach(self._any)

    def wait(self, timeout_s: float) -> bool:
        """Waits for a message. Returns False if none arrives within the time."""
        return self._waits.wait(max(0, round(timeout_s * 1e9))) > 0

    def take(self) -> Iterator[Any]:
        """All received messages, decoded, oldest first; undecodable ones are dropped."""
        for sample in self._samples():
            try:
                yield self._decode(sample)
            except DAMAGE:
                continue

    def take_while(self, wanted: Callable[[], bool], timeout_s: float) -> Iterator[Any]:
        """As of `take`, and, while more are wanted, those that come within the time."""
        until_s = time.monotonic() + timeout_s
        yield from self.take()
        while wanted() and self.wait(until_s - time.monotonic()):
            yield from self.take()

    def newest(self, timeout_s: float = 0.0) -> Any | None:
        """The newest message, if any is there or comes within the time; older ones are not decoded. Raises BridgeError
        if it is damaged."""
        samples = self._samples() if self.wait(timeout_s) else []
        try:
            return self._decode(samples[-1]) if samples else None
        except DAMAGE as error:
            raise BridgeError(f"{self.topic}: a damaged message ({type(error).__name__} {error})") from None

    def close(self) -> None:
        """Unsubscribe: first what waits for the reader, since Cyclone DDS may give its handle to a new entity."""
        self._waits = self._any = self._reader = None

    def __del__(self) -> None:
        self.close()

    def _samples(self) -> list[bytes]:
        taken = self._reader.take(self._depth)
        return [bytes(sample.cdr) for sample in taken if sample.sample_info.valid_data]


class Node:
    """A DDS participant in one domain. before: additional configuration of Cyclone DDS. Raises BridgeError if that
    cannot create it."""

    def __init__(self, discovery: Discovery, before: str = "") -> None:
        from cyclonedds.builtin import BuiltinDataReader, BuiltinTopicDcpsPublication
        from cyclonedds.core import DDSException
        from cyclonedds.domain import Domain, DomainParticipant

        domain, config = discovery.domain, discovery.cyclone_config(before)
        try:
            self._domain = Domain(domain, config) if config else None
            self.participant = DomainParticipant(domain)
        except DDSException as error:
            raise BridgeError(f"ROS 2: no DDS participant in domain {domain} ({error.msg})") from None
        self._publications: Any = BuiltinDataReader(self.participant, BuiltinTopicDcpsPublication)

    def published(self) -> dict[str, str]:
        """The topics that have a publisher now, each with its type."""
        publications = self._publications.read(1000)
        return {
            sample.topic_name.removeprefix("rt"): ros_kind(sample.type_name)
            for sample in publications
            if (getattr(sample, "topic_name", None) or "").startswith("rt/")  # None: its publisher has left
        }


def wait_for(answer: Callable[[], Answer | None], timeout_s: float) -> Answer | None:
    """The first answer that is not None; None where there is none within the time."""
    until_s = time.monotonic() + timeout_s
    while (found := answer()) is None and time.monotonic() < until_s:
        time.sleep(0.02)
    return found


@cache
def shared_node() -> Node:
    """This process's node, configured by the environment. Raises BridgeError, MissingExtraError without the extra."""
    need("ros2", "ROS 2")
    return Node(discovery_from(os.environ), os.environ.get("CYCLONEDDS_URI", ""))


@cache
def _topic(participant: Any, topic: str, kind: str) -> Any:
    from cyclonedds.topic import Topic

    made: Any = Topic(participant, dds_topic(topic), sample_type(kind))
    assert made.typename == dds_type(kind)
    return made


def _qos(kind: str, reliability: Reliability, depth: int) -> Any:
    from cyclonedds.core import Policy, Qos
    from cyclonedds.util import duration

    reliable = Policy.Reliability.Reliable(duration(milliseconds=BLOCK_MS))
    latched = reliability is Reliability.LATCHED
    policies = [
        Policy.Reliability.BestEffort if reliability is Reliability.BEST_EFFORT else reliable,
        Policy.Durability.TransientLocal if latched else Policy.Durability.Volatile,
        Policy.History.KeepLast(depth),
        Policy.DataRepresentation(use_cdrv0_representation=True, use_xcdrv2_representation=False),
    ]
    if (type_hash := HASHES.get(kind.replace("/msg/", "/"))) is not None:
        # ROS 2 since Iron identifies types by it, and warns if it is missing.
        policies.append(Policy.Userdata(f"typehash=RIHS01_{type_hash};".encode()))
    return Qos(*policies)
