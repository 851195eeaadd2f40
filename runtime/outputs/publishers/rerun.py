"""`--rerun`: the messages of a run to a Rerun viewer, or into an .rrd file."""

import math
import os
import socket
import threading
from collections.abc import Callable
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from typing import Any

from edgemap.geometry.map_object import MapObject
from edgemap.runtime.frames.errors import PublishError
from edgemap.runtime.frames.extras import need
from edgemap.runtime.frames.messages import topics
from edgemap.runtime.frames.messages.definitions import Message, to_ns
from edgemap.runtime.frames.timing import StreamTimer
from edgemap.runtime.outputs.messages.map_messages import CUBE, CYLINDER, TEXT
from edgemap.runtime.outputs.messages.stream import MessageStream
from edgemap.runtime.step.slam import StepResult

CONNECT_LIMIT_S, CLOSE_LIMIT_S = 2.0, 2.0
FLUSH_S = 0.5  # of what is logged, into file or viewer
CHECK_EVERY_S, PATIENCE_S = 1.0, 3.0  # by the clock: of a thread that nothing of the step waits for
UNIX_S = 1e8  # stamps above count from 1970, those below from some start of their own
TIMELINE = "stamp"
PICTURES_HZ, SLACK_S = 1.0, 1e-3  # a JPEG costs more than all else; stamps are not exact
FLOOR_RGBA, OBSTACLE_RGBA, SCAN_RGBA = (236, 240, 243, 255), (40, 46, 54, 255), (226, 96, 30, 255)
PICTURED = (topics.PICTURES, topics.BOXES)


class RerunStream:
    """A sink that logs every step. target: a new .rrd file, or a viewer's (host, port). pictures_hz: greatest rate of
    pictures with their boxes. Unchanged entities are not logged again.

    Entities: `map/objects`, `map/ellipses` and `map/floor` (3-D, metres), the tf tree as `map/odom/base_link/…`
    down to the camera, which holds `picture` and `detections` (2-D, pixels), and `faults`; `floor_scan` below
    base_link. A thread watches the viewer and reconnects; `write` raises PublishError, and logs nothing, while the
    viewer is closed or stalled: Rerun itself would not report the first, and would block the caller in the second once
    its buffers are full.
    Raises MissingExtraError, or PublishError where the file cannot be written or the viewer cannot be reached.
    """

    def __init__(self, target: Path | tuple[str, int], stream: MessageStream, pictures_hz: float = PICTURES_HZ) -> None:
        need("rerun", "--rerun")
        os.environ.setdefault("RUST_LOG", "off")  # what fails is said in our own line
        rr, rrb = (import_module(name) for name in ("rerun", "rerun.blueprint"))

        self.name, self._stream, self._rr = "Rerun", stream, rr
        self._picture_timer = StreamTimer(1.0 / pictures_hz - SLACK_S)
        self._known: dict[str, Any] = {}
        ids = stream.frames
        self._paths = {ids.map: "map", ids.odom: f"map/{ids.odom}", ids.base: f"map/{ids.odom}/{ids.base}"}
        self._camera = self._paths[ids.optical] = f"{self._paths[ids.base]}/{ids.optical}"
        batches = rr.ChunkBatcherConfig.DEFAULT()
        batches.flush_tick = FLUSH_S
        self._record = rr.RecordingStream("edgemap", batcher_config=batches)
        views = rrb.Horizontal(
            rrb.Spatial3DView(origin="map"),
            rrb.Vertical(rrb.Spatial2DView(origin=self._camera), rrb.TextLogView(origin="faults"), row_shares=[4, 1]),
        )
        self._target, self._away, self._closed = target, "", threading.Event()
        self._options: dict[str, Any] = {"default_blueprint": rrb.Blueprint(views)}
        if isinstance(target, Path):
            if target.exists():
                raise PublishError(f"--rerun {target}: exists already; choose another file")
            try:
                self._record.save(target, **self._options)
            except (OSError, RuntimeError) as error:
                raise PublishError(f"--rerun {target}: cannot be written ({error})") from None
        else:
            try:
                self._connect(*target)
            except OSError as error:
                place = f"{target[0]}:{target[1]}"
                raise PublishError(f"--rerun: no viewer at {place} ({error}); start one there: rerun") from None
            threading.Thread(target=self._watch, args=target, name="Rerun viewer", daemon=True).start()
        self._record.log("map", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        self._log: dict[str, Callable[[Message], None]] = {
            topics.PICTURES: self._picture,
            topics.INFO: self._lens,
            topics.TF: self._transforms,
            topics.BOXES: self._boxes,
            topics.MARKERS: self._markers,
            topics.MAP: self._floor,
            topics.FLOOR_SCAN: self._scan,
        }

    def write(self, result: StepResult, objects: list[MapObject]) -> None:
        """Log the step at the frame's stamp."""
        if self._away:
            raise PublishError(self._away)
        stamp_s = result.frame.stamp_s
        self._set_time(stamp_s)
        pictured = self._picture_timer.due(stamp_s)
        for outgoing in self._stream.step(result, objects):
            if outgoing.topic in self._log and (pictured or outgoing.topic not in PICTURED):
                self._log[outgoing.topic](outgoing.make())

    def fault(self, text: str) -> None:
        """Log it, where a viewer is connected."""
        if not self._away:
            self._record.log("faults", self._rr.TextLog(text, level="WARN"))

    def close(self) -> None:
        """Finish the file, or let go of the viewer; may be called twice."""
        if self._closed.is_set():
            return
        self._closed.set()
        if isinstance(self._target, Path):
            self._record.disconnect()
            return
        farewell = threading.Thread(target=self._record.disconnect, name="Rerun farewell", daemon=True)
        farewell.start()
        farewell.join(CLOSE_LIMIT_S)
        if farewell.is_alive():  # a viewer that takes nothing; at the process's end Rerun would wait for it once more
            self._rr.unregister_shutdown()

    def _connect(self, host: str, port: int) -> None:
        """Raises OSError where no viewer listens: Rerun's own attempt takes 5 s and reports nothing."""
        socket.create_connection((host, port), CONNECT_LIMIT_S).close()
        shown = f"[{host}]" if ":" in host else host
        self._record.connect_grpc(f"rerun+http://{shown}:{port}/proxy", **self._options)

    def _watch(self, host: str, port: int) -> None:
        """On a thread: whether the viewer takes what is logged; a connection that is gone is made again."""
        while not self._closed.wait(CHECK_EVERY_S):
            try:
                self._record.flush(timeout_sec=PATIENCE_S)
                self._away = ""
            except RuntimeError as error:
                if "timed out" in str(error):
                    self._away = f"the viewer at {host}:{port} has taken nothing for {PATIENCE_S:.0f} s"
                    continue
                self._away = f"no viewer at {host}:{port}"
                with suppress(OSError):
                    self._connect(host, port)
                    self._known = {}
                    self._record.log("map", self._rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)

    def _set_time(self, stamp_s: float) -> None:
        if stamp_s > UNIX_S:
            import numpy as np

            self._record.set_time(TIMELINE, timestamp=np.datetime64(to_ns(stamp_s), "ns"))
        else:
            self._record.set_time(TIMELINE, duration=stamp_s)

    def _picture(self, message: Message) -> None:
        picture = self._rr.EncodedImage(contents=message["data"], media_type=f"image/{message['format']}")
        self._record.log(f"{self._camera}/picture", picture)

    def _lens(self, message: Message) -> None:
        k, size = message["k"], (message["width"], message["height"])
        if self._same("lens", (k, size)):
            return
        lens = self._rr.Pinhole(image_from_camera=[k[0:3], k[3:6], k[6:9]], resolution=size)
        self._record.log(self._camera, lens)

    def _transforms(self, message: Message) -> None:
        for item in message["transforms"]:
            path = self._paths[item["child_frame_id"]]
            moved, rotated = item["transform"]["translation"], item["transform"]["rotation"]
            if self._same(path, [round(value, 9) for value in (*_xyz(moved), *_xyz(rotated))]):
                continue
            transform = self._rr.Transform3D(translation=_xyz(moved), quaternion=[*_xyz(rotated), rotated["w"]])
            self._record.log(path, transform)

    def _same(self, path: str, value: Any) -> bool:
        """Whether that is what was logged there last; from now on it is."""
        same = self._known.get(path) == value
        self._known[path] = value
        return same

    def _boxes(self, message: Message) -> None:
        found = message["detections"]
        boxes = [item["bbox"] for item in found]
        best = [item["results"][0]["hypothesis"] for item in found]
        drawn = self._rr.Boxes2D(
            centers=[(box["center"]["position"]["x"], box["center"]["position"]["y"]) for box in boxes],
            sizes=[(box["size_x"], box["size_y"]) for box in boxes],
            labels=[
                f"{item['class_id']} {item['score']:.2f} {box['id']}".rstrip()
                for item, box in zip(best, found, strict=True)
            ],
        )
        self._record.log(f"{self._camera}/detections", drawn)

    def _floor(self, message: Message) -> None:
        """The grid as a textured rectangle a little below the floor: free light, occupied dark, unknown clear."""
        import numpy as np

        info = message["info"]
        cells = np.frombuffer(message["data"], np.int8).reshape(info["height"], info["width"])
        x_m, y_m = info["origin"]["position"]["x"], info["origin"]["position"]["y"]
        x1_m, y1_m = x_m + info["width"] * info["resolution"], y_m + info["height"] * info["resolution"]
        picture = np.zeros((*cells.shape, 4), np.uint8)
        picture[cells == 0], picture[cells > 0] = FLOOR_RGBA, OBSTACLE_RGBA
        corners = [[x, y, -0.01] for x, y in ((x_m, y_m), (x1_m, y_m), (x1_m, y1_m), (x_m, y1_m))]
        floor = self._rr.Mesh3D(
            vertex_positions=corners,
            triangle_indices=[[0, 1, 2], [0, 2, 3]],
            vertex_texcoords=[[0, 0], [1, 0], [1, 1], [0, 1]],
            albedo_texture=picture,
        )
        self._record.log("map/floor", floor)

    def _scan(self, message: Message) -> None:
        """The contacts of the newest picture that was fused, as points beside the robot."""
        points = [
            (beam_m * math.cos(angle), beam_m * math.sin(angle), 0.0)
            for k, beam_m in enumerate(message["ranges"])
            if math.isfinite(beam_m)
            for angle in (message["angle_min"] + k * message["angle_increment"],)
        ]
        base = self._paths[message["header"]["frame_id"]]
        self._record.log(f"{base}/floor_scan", self._rr.Points3D(points, radii=0.02, colors=[SCAN_RGBA]))

    def _markers(self, message: Message) -> None:
        """All objects of the map at once, in place of those before."""
        rr, kinds = self._rr, {CUBE: [], CYLINDER: [], TEXT: []}
        for marker in message["markers"]:
            if "type" in marker:
                kinds[marker["type"]].append(marker)
        for path, shape, kind in (("objects", rr.Boxes3D, CUBE), ("ellipses", rr.Ellipsoids3D, CYLINDER)):
            markers = kinds[kind]
            options: dict[str, Any] = {
                "centers": [_xyz(marker["pose"]["position"]) for marker in markers],
                "half_sizes": [[side / 2.0 for side in _xyz(marker["scale"])] for marker in markers],
                "colors": [[round(255 * marker["color"][part]) for part in "rgba"] for marker in markers],
            }
            if kind == CUBE:
                options["labels"] = [marker["text"] for marker in kinds[TEXT]]
            else:
                rotations = [marker["pose"]["orientation"] for marker in markers]
                options["quaternions"] = [[*_xyz(rotation), rotation["w"]] for rotation in rotations]
            self._record.log(f"map/{path}", shape(**options))


def _xyz(vector: Message) -> list[float]:
    return [vector["x"], vector["y"], vector["z"]]
