"""The state of a run as `diagnostic_msgs/DiagnosticArray`: camera, pose, map, and every kind of fault that occurred."""

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from enum import IntEnum

from edgemap.bridges.ros2.messages.build import header
from edgemap.bridges.ros2.messages.definitions import Message
from edgemap.runtime.frames.errors import CameraState
from edgemap.runtime.frames.faults import Fault, FaultKind
from edgemap.runtime.outputs.verdict.verdict import WRONG_DEG, WRONG_M, Verdict
from edgemap.runtime.step.slam import StepResult


class Level(IntEnum):
    """Of diagnostic_msgs/DiagnosticStatus."""

    OK = 0
    WARN = 1
    ERROR = 2


LEVELS = {"good": Level.OK, "care": Level.WARN, "unreliable": Level.ERROR}
CAMERA = {CameraState.RUNNING: Level.OK, CameraState.DEGRADED: Level.WARN, CameraState.LOST: Level.ERROR}
NEWS_S = 5.0  # for which a fault is a warning: diagnostic_aggregator's own timeout


class RunDiagnostics:
    """Gathers what the statuses say. name: before each status's; hardware: the robot."""

    def __init__(self, name: str, hardware: str) -> None:
        self._name, self._hardware = name, hardware
        self._counts, self._last = Counter[FaultKind](), dict[FaultKind, tuple[float, str]]()
        self._pose: Message | None = None  # of the last step

    def fault(self, fault: Fault, at_s: float) -> None:
        """Counts a fault. at_s: by any clock, that of `message`."""
        self._counts[fault.kind] += 1
        self._last[fault.kind] = at_s, fault.text

    def step(self, result: StepResult) -> None:
        """Keeps the pose of a step."""
        x_m, y_m, yaw_rad = result.pose_map_base.vector().tolist()
        sigma_m = math.sqrt(max(float(result.pose_covariance[0, 0] + result.pose_covariance[1, 1]), 0.0))
        sigma_deg = math.degrees(math.sqrt(max(float(result.pose_covariance[2, 2]), 0.0)))
        values = {"x_m": x_m, "y_m": y_m, "yaw_deg": math.degrees(yaw_rad), "sigma_m": sigma_m, "sigma_deg": sigma_deg}
        level, text = Level.OK, "measured"
        if result.motion.blind:
            level, text = Level.WARN, "not measured: the pose is a guess"
        if sigma_m > WRONG_M or sigma_deg > WRONG_DEG:
            level, text = Level.WARN, f"uncertain by {sigma_m:.2f} m, {sigma_deg:.0f} degrees"
        self._pose = self._status("pose", level, text, {key: f"{value:.3f}" for key, value in values.items()})

    def message(self, stamp_ns: int, camera: CameraState, verdict: Verdict, now_s: float) -> Message:
        """All statuses. now_s: by the clock of `fault`."""
        reasons = {f"reason {at}": text for at, text in enumerate(verdict.document()["reasons"], 1)}
        statuses = [
            self._status("camera", CAMERA[camera], str(camera), {}),
            self._status("map", LEVELS[verdict.level], verdict.line, reasons),
            *([self._pose] if self._pose else []),
        ]
        for kind, (at_s, text) in self._last.items():
            news = now_s - at_s < NEWS_S and not kind.notice
            values = {"count": str(self._counts[kind])}
            statuses.append(self._status(f"fault {kind}", Level.WARN if news else Level.OK, text, values))
        return {"header": header(stamp_ns, ""), "status": statuses}

    def _status(self, name: str, level: int, text: str, values: Mapping[str, str]) -> Message:
        pairs = [{"key": key, "value": value} for key, value in values.items()]
        named = {"name": f"{self._name}: {name}", "hardware_id": self._hardware}
        return named | {"level": level, "message": text, "values": pairs}


def label_info(stamp_ns: int, classes: Sequence[str], threshold: float, frame_id: str) -> Message:
    """`vision_msgs/LabelInfo`: the detector's classes in its order, and the score from which on a box counts."""
    entries = [{"class_id": number, "class_name": name} for number, name in enumerate(classes)]
    return {"header": header(stamp_ns, frame_id), "class_map": entries, "threshold": threshold}
