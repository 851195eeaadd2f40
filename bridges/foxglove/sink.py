"""`--foxglove`: a WebSocket server that Foxglove connects to, with the messages of the recordings."""

import threading
from collections.abc import Iterable

from edgemap.bridges.ros2.messages import topics
from edgemap.bridges.ros2.messages.definitions import definition, encoder, to_ns
from edgemap.bridges.ros2.messages.stream import MessageStream, Outgoing
from edgemap.geometry.map_object import MapObject
from edgemap.runtime.frames.colours import label_rgb
from edgemap.runtime.frames.errors import BridgeError
from edgemap.runtime.frames.extras import need
from edgemap.runtime.frames.faults import Fault
from edgemap.runtime.frames.limits import PATIENCE_S
from edgemap.runtime.frames.option_texts import host_and_port
from edgemap.runtime.outputs.sinks.kinds import RunInfo
from edgemap.runtime.step.slam import StepResult

ANNOTATIONS = "/detections/annotations"
SENT = (
    topics.PICTURES, topics.INFO, topics.TF, topics.POSE, topics.ODOMETRY, topics.BOXES, topics.OBJECTS, topics.MARKERS,
    topics.GRID, topics.MAP, topics.FLOOR_SCAN,
)  # fmt: skip


class FoxgloveServer:
    """A sink that serves ROS 2 messages (CDR) and image annotations to any number of Foxglove clients.

    A message is built when a client has subscribed to its topic. The server's own threads send it, and drop the oldest
    for a client that is slow. Clients cannot publish. host: anyone who reaches the address sees the pictures. port: 0
    for any free one. Raises MissingExtraError, or BridgeError where the address cannot be bound.
    """

    def __init__(self, host: str, port: int, stream: MessageStream) -> None:
        need("foxglove", "--foxglove")
        import foxglove
        from foxglove.channels import ImageAnnotationsChannel

        self.name = "Foxglove"
        self._stream, self._closed = stream, False
        self._context = context = foxglove.Context()  # channels and server do not keep it alive
        foxglove.set_log_level("CRITICAL")  # others' messages stand in its errors
        try:
            self._server = foxglove.start_server(
                name="edgemap", host=host, port=port, context=context, capabilities=[foxglove.Capability.Time],
                message_backlog_size=128,  # of a client that is slow: a second or two at 10 Hz
            )  # fmt: skip
        except (RuntimeError, OverflowError) as error:
            raise BridgeError(f"--foxglove {host}:{port}: {error}") from None
        self.url = f"ws://{host}:{self._server.port}"
        self._channels = {
            topic: foxglove.Channel(
                topic,
                schema=foxglove.Schema(name=topic.kind, encoding="ros2msg", data=definition(topic.kind).encode()),
                message_encoding="cdr",
                context=context,
            )
            for topic in SENT
        }
        self.annotations = ImageAnnotationsChannel(ANNOTATIONS, context=context)

    def write(self, result: StepResult, objects: list[MapObject]) -> None:
        """Sends the step to subscribed clients. The server's time is that of the frame."""
        self._send(self._stream.step(result, objects), result)

    def last(self, result: StepResult, objects: list[MapObject]) -> None:
        """Sends the boxes that came after the last frame, and the map."""
        self._send(self._stream.last(result, objects), result)

    def _send(self, messages: Iterable[Outgoing], result: StepResult) -> None:
        stamp_ns = to_ns(result.frame.stamp_s)
        for outgoing in messages:
            channel = self._channels[outgoing.topic]
            if channel.has_sinks():
                channel.log(encoder(outgoing.topic.kind)(outgoing.make()), log_time=outgoing.stamp_ns)
        if self.annotations.has_sinks():
            self.annotations.log(image_annotations(to_ns(result.pictured.stamp_s), result), log_time=stamp_ns)
        self._server.broadcast_time(stamp_ns)

    def fault(self, fault: Fault) -> None:
        """Show it among Foxglove's problems."""
        from foxglove.websocket import StatusLevel

        self._server.publish_status(fault.text, StatusLevel.Warning)

    def close(self) -> None:
        """Disconnects the clients; may be called twice."""
        if not self._closed:
            self._closed = True
            farewell = threading.Thread(target=self._server.stop, name="Foxglove farewell", daemon=True)
            farewell.start()
            farewell.join(PATIENCE_S)  # the server's own would be 40 s


def image_annotations(stamp_ns: int, result: StepResult):  # noqa: ANN201  (a type of an extra)
    """`foxglove.ImageAnnotations`: each box in its label's colour, with label, score and object."""
    from foxglove import messages

    objects = result.object_of_box
    stamp = messages.Timestamp(stamp_ns // 10**9, stamp_ns % 10**9)
    boxes, white = result.detections, messages.Color(r=1.0, g=1.0, b=1.0, a=1.0)
    points, texts = [], []
    for index, (box, score, label) in enumerate(zip(boxes.boxes.tolist(), boxes.scores, boxes.labels, strict=True)):
        x0, y0, x1, y1 = box
        red, green, blue = label_rgb(label)
        colour = messages.Color(r=red, g=green, b=blue, a=1.0)
        points.append(
            messages.PointsAnnotation(
                timestamp=stamp,
                type=messages.PointsAnnotationType.LineLoop,
                points=[messages.Point2(x=x, y=y) for x, y in ((x0, y0), (x1, y0), (x1, y1), (x0, y1))],
                outline_color=colour,
                thickness=2.0,
            )
        )
        texts.append(
            messages.TextAnnotation(
                timestamp=stamp,
                position=messages.Point2(x=x0, y=y0),
                text=f"{label} {score:.2f} {objects.get(index, '')}".rstrip(),
                font_size=14.0,
                text_color=white,
                background_color=colour,
            )
        )
    return messages.ImageAnnotations(points=points, texts=texts)


def open(address: str, run: RunInfo) -> FoxgloveServer:
    """The sink of `--foxglove HOST:PORT`. Raises UsageError, or as the server does."""
    host, port = host_and_port(address, "--foxglove", 8765)
    server = FoxgloveServer(host, port, MessageStream(run.floor.intrinsics, run.floor.mount))
    print(f"Foxglove:  {server.url}", flush=True)
    return server
