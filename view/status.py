"""State of the run in words: the problems that need attention, most severe first."""

import math
import time
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from edgemap.runtime.step.slam import StepResult
from edgemap.view.page import LivePage

SILENT_S = 2.0  # without a step
SLOW_SHARE = 0.85  # of the camera's rate; below it pictures are dropped or come late
BUSY_SHARE = 0.5  # of the time in steps; below it the camera is slower than it states, as in dim light
NEWS_S = 15.0  # a reported fault stays among the problems this long
UNSURE_M, UNSURE_RAD = 0.5, math.radians(15.0)  # one sigma of the pose at which the map cannot be trusted

UNKNOWN_RAD = math.radians(90.0)  # of the heading: it may point anywhere

Level = Literal["ok", "degraded", "fault"]

# What the end of a run is shown as, by how far its map can be trusted.
LEVELS: dict[str, Level] = {"good": "ok", "care": "degraded", "unreliable": "fault"}


@dataclass(frozen=True, slots=True)
class Alert:
    """level: fault (nothing is mapped) or degraded (mapping continues with lower quality). what: camera, picture,
    speed, odometry, pose or report. text: one sentence.
    """

    level: Level
    what: str
    text: str


def problems(page: LivePage) -> list[Alert]:
    """The current problems, faults first; empty without problems, and while the run is paused or over."""
    snapshot = page.newest
    if page.state != "running" or snapshot is None:
        return []
    age_s, alerts = time.monotonic() - snapshot.arrived_s, []
    camera = page.camera_state()
    if camera == "lost":
        alerts.append(Alert("fault", "camera", "The camera is lost. The map so far is saved."))
    elif camera != "running":
        alerts.append(Alert("fault", "camera", f"No picture for {age_s:.0f} s. The camera is being restarted."))
    elif age_s > SILENT_S:
        alerts.append(Alert("fault", "camera", f"No picture for {age_s:.0f} s."))
    alerts += _of_step(page, snapshot.result)
    if page.searching():
        text = "Looking for the robot's place in the saved map. Until it is found, this map stands alone."
        alerts.append(Alert("degraded", "pose", text))
    health, (last, reported_s) = snapshot.result.health, page.last_fault or (None, 0.0)
    shown = {fault.kind for fault in (*snapshot.result.motion.faults, health.blindness) if fault}  # by `_of_step`
    if last and time.monotonic() - reported_s < NEWS_S and last.kind not in shown:
        alerts.append(Alert("degraded", "report", _sentence(last.text)))
    return sorted(alerts, key=lambda problem: problem.level != "fault")


def status(page: LivePage) -> dict[str, Any]:
    """level, the problems in order of severity, and a headline."""
    alerts, verdict = problems(page), page.verdict()
    level: Level = alerts[0].level if alerts else "ok"
    if page.state == "finished" and verdict is not None:
        level = LEVELS[verdict.level]
    answer = {"level": level, "headline": alerts[0].text if alerts else _calm(page), "problems": alerts}
    return answer | ({"verdict": verdict.document()} if verdict else {})


def pose_sigma(result: StepResult) -> tuple[float, float]:
    """One standard deviation of the pose: m (mean of both axes), rad."""
    covariance = result.pose_covariance
    return (
        math.sqrt(max(0.0, float(np.trace(covariance[:2, :2])) / 2.0)),
        math.sqrt(max(0.0, float(covariance[2, 2]))),
    )


def _of_step(page: LivePage, result: StepResult) -> list[Alert]:
    alerts = []
    if result.health.blindness is not None:
        level: Level = "degraded" if result.health.stale else "fault"
        alerts.append(Alert(level, "picture", f"The picture has no information: {result.health.blindness}."))
    if result.motion.faults:
        alerts.append(Alert("degraded", "odometry", f"Odometry: {'; '.join(map(str, result.motion.faults))}."))
    rate_hz, wanted_hz = page.rate_hz(), page.camera_hz() or 0.0
    mean_ms = page.step_ms()
    busy = rate_hz is not None and rate_hz * mean_ms > 1000.0 * BUSY_SHARE
    if busy and rate_hz and page.rate_known and rate_hz < SLOW_SHARE * wanted_hz:
        text = f"Overloaded: {rate_hz:.1f} of {wanted_hz:.0f} pictures a second, {mean_ms:.0f} ms each."
        alerts.append(Alert("degraded", "speed", text))
    away_m, turned_rad = pose_sigma(result)
    if away_m > UNSURE_M or turned_rad > UNSURE_RAD:
        heading = "heading unknown" if turned_rad > UNKNOWN_RAD else f"± {math.degrees(turned_rad):.0f}°"
        text = f"The position is uncertain: ± {away_m:.1f} m, {heading}."
        alerts.append(Alert("degraded", "pose", text))
    return alerts


def _calm(page: LivePage) -> str:
    if page.state == "finished":
        verdict = page.verdict()
        return "The run is over. " + (_sentence(verdict.line.capitalize()) if verdict else "This is the map it saved.")
    if page.state == "paused":
        return "Paused."
    if page.newest is None:
        return "Waiting for the first picture."
    rate_hz = page.rate_hz()
    return "Running" + (f", {rate_hz:.1f} pictures a second." if rate_hz else ".")


def _sentence(text: str) -> str:
    return text + ("" if text.endswith(".") else ".")
