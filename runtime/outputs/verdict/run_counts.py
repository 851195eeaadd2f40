"""What a run counts for its verdict, in memory: a run folder writes it, and a session is judged by it."""

import math
from collections import Counter
from typing import Any

import numpy as np

from edgemap.geometry.camera.attitude import MountEstimate
from edgemap.geometry.map_object import MapObject
from edgemap.geometry.objects.scale import scaled_objects
from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.faults import Fault, FaultKind
from edgemap.runtime.outputs.verdict.doubled import DoubledObjects
from edgemap.runtime.outputs.verdict.verdict import Verdict, verdict_of
from edgemap.runtime.step.sinks import Sink
from edgemap.runtime.step.slam import StepResult


class RunCounts(Sink):
    """A sink that counts. record: other entries of run.json; lens, mount, odometry and camera_guess count in the
    verdict."""

    name = "verdict"

    def __init__(self, record: dict[str, Any]) -> None:
        self.record = record
        self.mount_seen: dict[str, float] = {}  # as the drive has shown it so far
        self.objects: list[MapObject] = []  # of the newest map
        self.frames = 0
        self._vanished: tuple[MapObject, ...] = ()  # likewise
        self._long_gone: set[str] = set()  # ids of those that had vanished before this run
        self._doubled = [DoubledObjects()]  # since the start, and since a person has set the pose
        self._pose_map_odom = SE2()
        self._kinds: Counter[str] = Counter()
        self._attitudes: Counter[str] = Counter()  # frames by where roll and pitch came from
        self._counts: Counter[str] = Counter()
        self._blind: Counter[FaultKind] = Counter()
        self._wheels = False
        self._first_s = self._last_s = math.nan
        self._steps_s: list[float] = []
        self._travelled_m = 0.0
        self._sigma = self._largest = np.zeros(2)  # of position, m, and heading, rad

    def write(self, result: StepResult, objects: list[MapObject]) -> None:
        """Counts one step."""
        self.objects, self._vanished = objects, result.annotations.vanished
        if self.frames == 0 or result.relocated is not None:
            self._long_gone = {item.id for item in self._vanished}
        observed, health = result.observed, result.health
        if (seen := observed.mount_estimate) is not None:
            self.mount_seen |= mount_record(seen)
        if (height := observed.height_estimate) is not None:
            self.mount_seen |= {"height_m": round(height.height_m, 3), "sigma_height_m": round(height.sigma_m, 3)}
        stamp_s, pose_map_odom = result.frame.stamp_s, result.pose_map_base @ result.pose_odom_base.inverse()
        stays = (self._pose_map_odom.inverse() @ pose_map_odom).is_within(1e-6)  # up to rounding
        if self.frames and not stays and result.correction is None and result.relocated is None:
            self._doubled[1:] = [DoubledObjects(stamp_s)]
        self._pose_map_odom = pose_map_odom
        if self.frames and len(self._steps_s) < 10_000:
            self._steps_s.append(stamp_s - self._last_s)
        self._first_s = stamp_s if math.isnan(self._first_s) else self._first_s
        self._last_s = stamp_s
        members = result.motion.members
        attitude = observed.camera.attitude if observed.camera else None
        self._attitudes[observed.attitude_source] += 1
        self.frames += 1
        if health.blindness is not None:
            kind = health.blindness.kind
            self._blind[kind] += not health.stale or (kind is FaultKind.FROZEN and result.motion.blind)
        self._wheels |= "wheels" in members
        self._counts.update(
            guessed_frames=result.motion.blind,
            still_frames=observed.at_rest,
            wheel_frames=members.get("wheels") == "used",
            camera_frames=members.get("camera") == "used",
            gyro_frames=members.get("gyro") == "used",
            object_frames=bool(result.sightings),
            carried_frames=bool(attitude and attitude.carried),
            mount_frames=observed.attitude_source == "mount",
            worktop_frames=observed.worktop,
            searched_frames=observed.searched,
        )
        self._travelled_m = result.travelled_m
        covariance = result.pose_covariance
        variances = np.linalg.eigvalsh(covariance[:2, :2])[-1], covariance[2, 2]
        self._sigma = np.sqrt(np.maximum(variances, 0.0))
        self._largest = np.maximum(self._largest, self._sigma)

    def quality(self, scale: float = 1.0) -> dict[str, Any]:
        """The counts so far, as plain values. scale: by which lengths are multiplied.

        frames: all. blind_frames: pictures without information, by kind in `blind`; one that only repeats while the
        robot rests does not count. guessed_frames: nothing measured the motion. still_frames: the robot at rest.
        wheels: whether the source or an option declares wheel odometry, with data or without. wheel_frames,
        camera_frames, gyro_frames: that member of the odometry was used. object_frames: with an object on the floor.
        carried_frames: the camera sways as in a hand or on a head. mount_frames: roll and pitch were the mount's,
        unmeasured. worktop_frames: cups, books or the like stood on the floor mask. searched_frames: with a detector's
        boxes, searched_hz a second. travelled_m. sigma_m, heading_sigma_deg: standard deviation of the pose, at the end
        and the largest along the way. duration_s: of stream. rate_hz: median. doubled: objects that stand twice.
        """
        names = ("guessed", "still", "wheel", "camera", "gyro", "object", "carried", "mount", "worktop", "searched")
        vanished = [item for item in self._vanished if item.id not in self._long_gone]
        doubled = (since.seen(self.objects, vanished) for since in self._doubled)
        step_s = float(np.median(self._steps_s)) if self._steps_s else 0.0
        duration_s = self._last_s - self._first_s if self.frames else 0.0
        sigmas = {"end": self._sigma.tolist(), "largest": self._largest.tolist()}
        return {
            "frames": self.frames,
            "blind_frames": sum(self._blind.values()),
            "blind": {kind.value: count for kind, count in self._blind.items() if count},
            **{f"{name}_frames": self._counts[f"{name}_frames"] for name in names},
            "wheels": self._wheels,
            "travelled_m": round(scale * self._travelled_m, 3),
            "sigma_m": {when: round(scale * sigma_m, 4) for when, (sigma_m, _) in sigmas.items()},
            "heading_sigma_deg": {when: round(math.degrees(rad), 3) for when, (_, rad) in sigmas.items()},
            "duration_s": round(duration_s, 3),
            "rate_hz": round(1.0 / step_s, 2) if step_s > 0.0 else None,
            "searched_hz": round(self._counts["searched_frames"] / duration_s, 2) if duration_s > 0.0 else None,
            "doubled": next(filter(None, doubled), None),
        }

    def fault(self, fault: Fault) -> None:
        """Counts a fault by its kind."""
        self._kinds[fault.kind.value] += 1

    def last(self, result: StepResult, objects: list[MapObject]) -> None:
        """The objects with the last boxes."""
        self.objects, self._vanished = objects, result.annotations.vanished

    def close(self) -> None:
        """The map is complete."""
        for since in self._doubled:
            since.ended()

    def document(self, scale: float = 1.0) -> dict[str, Any]:
        """The record with all counts. scale: by which lengths are multiplied."""
        seen = {"mount_seen": dict(self.mount_seen)} if self.mount_seen else {}
        counts = {
            "attitude_sources": dict(self._attitudes),
            "quality": self.quality(scale),
            "fault_count": self._kinds.total(),
            "fault_kinds": dict(self._kinds),
        }
        return self.record | seen | counts

    def verdict(self, scale: float = 1.0) -> Verdict:
        """How far the map can be trusted as it stands."""
        return verdict_of(self.document(scale), scaled_objects(self.objects, scale))


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
