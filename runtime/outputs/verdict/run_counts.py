"""What a run counts for its verdict, in memory: a run folder writes it, and a session is judged by it."""

import math
from collections import Counter
from typing import Any

from edgemap.geometry.camera.attitude import MountEstimate
from edgemap.geometry.map_object import MapObject
from edgemap.geometry.objects.scale import scaled_objects
from edgemap.runtime.frames.faults import Fault
from edgemap.runtime.outputs.verdict.quality import QualityCounter
from edgemap.runtime.outputs.verdict.verdict import Verdict, verdict_of
from edgemap.runtime.step.sinks import Sink
from edgemap.runtime.step.slam import StepResult


class RunCounts(Sink):
    """A sink that counts. record: other entries of run.json; lens, mount, odometry and camera_guess have a say in the
    verdict."""

    name = "verdict"

    def __init__(self, record: dict[str, Any]) -> None:
        self.record = record
        self.mount_seen: dict[str, float] = {}  # as the drive has shown it so far
        self._objects: list[MapObject] = []
        self._kinds: Counter[str] = Counter()
        self._quality = QualityCounter()
        self._attitudes: Counter[str] = Counter()  # frames by where roll and pitch came from

    def write(self, result: StepResult, objects: list[MapObject]) -> None:
        """Counts one step."""
        self._objects = objects
        self._attitudes[result.observed.attitude_source] += 1
        self._quality.add(result)
        if (seen := result.observed.mount_estimate) is not None:
            self.mount_seen |= mount_record(seen)
        if (height := result.observed.height_estimate) is not None:
            self.mount_seen |= {"height_m": round(height.height_m, 3), "sigma_height_m": round(height.sigma_m, 3)}

    def fault(self, fault: Fault) -> None:
        """Counts a fault by its kind."""
        self._kinds[fault.kind.value] += 1

    def edited(self, objects: list[MapObject]) -> None:
        """The objects as a person has just edited them."""
        self._objects = objects

    def document(self, scale: float = 1.0) -> dict[str, Any]:
        """The record with all counts. scale: by which lengths are multiplied."""
        seen = {"mount_seen": dict(self.mount_seen)} if self.mount_seen else {}
        counts = {
            "attitude_sources": dict(self._attitudes),
            "quality": self._quality.document(scale),
            "fault_count": self._kinds.total(),
            "fault_kinds": dict(self._kinds),
        }
        return self.record | seen | counts

    def verdict(self, scale: float = 1.0) -> Verdict:
        """How far the map can be trusted as it stands."""
        return verdict_of(self.document(scale), scaled_objects(self._objects, scale))


def mount_record(seen: MountEstimate) -> dict[str, float]:
    """The estimate of a mount's angles so far, degrees."""
    angles = {
        "pitch_deg": seen.mount.pitch_rad,
        "roll_deg": seen.mount.roll_rad,
        "used_pitch_deg": seen.used.pitch_rad,
        "used_roll_deg": seen.used.roll_rad,
        "sigma_pitch_deg": seen.sigma_rad[1],
        "sigma_roll_deg": seen.sigma_rad[0],
    }
    return {name: round(math.degrees(angle), 2) for name, angle in angles.items()}
