"""Faults of a run: what went wrong, by kind. The text is for people; no code reads it. What readers leave out of their
files are faults of the run that opens them, or lines on standard error."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

from edgemap.runtime.frames.reading import print_message, without_secrets


class FaultKind(StrEnum):
    """Kind of a fault. The verdict, the live page, the report and `edgemap why` go by it."""

    # Delivery of frames
    LATE = "late"  # silent beyond the stall limit
    FAILED = "failed"  # the device's driver raised an error
    CLOSED = "closed"  # the device does not open
    REMOVED = "removed"  # the system reports that the device was removed
    LOST = "lost"  # a live camera that its supervisor has given up on
    STAMP = "stamp"  # a stamp that repeats or is not a number
    CLOCK = "clock"  # stamps that jump
    SIZE = "size"  # a picture of another size
    FORMAT = "format"  # a picture that is not (H, W, 3) uint8, or inertial samples that are none
    DAMAGED = "damaged"  # a picture that cannot be decoded
    RECOVERED = "recovered"
    DEPTH = "depth"  # pictures of depth that cannot be used
    SAMPLES = "samples"  # of wheels, IMU or poses that are none, and are dropped
    # Contents of a picture
    DARK = "dark"
    BLOWN = "blown"
    COVERED = "covered"
    COVERED_IN_PART = "covered_in_part"
    BLURRED = "blurred"
    FROZEN = "frozen"
    REPEATED = "repeated"
    TORN = "torn"
    # Motion
    ODOMETRY = "odometry"  # measures nothing, or starts again
    OUT_OF_RANGE = "out_of_range"  # numbers that no motion of one step has
    POSES = "poses"  # recorded poses do not cover a step
    POSES_EXCLUDED = "poses_excluded"  # they contradict the camera
    POSES_CONVERTED = "poses_converted"  # they were read in axes, an order or a unit that the motion shows
    WHEELS = "wheels"  # wheel odometry does not cover a step
    WHEELS_EXCLUDED = "wheels_excluded"  # they contradict the camera
    WHEELS_RESTORED = "wheels_restored"
    DISAGREEMENT = "disagreement"  # sources of the fused motion
    GYRO = "gyro"  # no samples
    IMU_EXCLUDED = "imu_excluded"
    DEPTH_EXCLUDED = "depth_excluded"  # its scale contradicts the floor
    IMU_RESTORED = "imu_restored"
    MOUNT_ANGLES = "mount_angles"  # contradicted by the drive
    MOUNT_HEIGHT = "mount_height"  # contradicted by the drive
    # The run
    OUTPUT = "output"  # a sink fails
    OUTPUT_RESTORED = "output_restored"
    EDIT = "edit"  # a recorded edit that is refused, or an edited map that is not taken
    ENDED = "ended"  # the failure that ended the run
    OTHER = "other"  # recorded without a kind, or with one of another version

    @property
    def notice(self) -> bool:
        """Whether it reports the end of a fault."""
        return self in {
            FaultKind.RECOVERED, FaultKind.WHEELS_RESTORED, FaultKind.IMU_RESTORED, FaultKind.OUTPUT_RESTORED,
        }  # fmt: skip


@dataclass(frozen=True, slots=True)
class Fault:
    """One fault or notice. text: one line. frame: number of frames done when it was reported; None if not counted."""

    kind: FaultKind
    text: str
    frame: int | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "text", without_secrets(self.text))

    def __str__(self) -> str:
        return self.text

    @property
    def line(self) -> str:
        """The text with its frame."""
        return self.text if self.frame is None else f"frame {self.frame}: {self.text}"

    def document(self) -> dict[str, Any]:
        """Plain values, as in run.json."""
        return {"kind": self.kind.value, "frame": self.frame, "text": self.text}


def read_fault(entry: Any) -> Fault:
    """A fault of a run.json; a line of text, as older ones have it, is `OTHER`. Raises TypeError and KeyError."""
    if isinstance(entry, str):
        return Fault(FaultKind.OTHER, entry)
    if not isinstance(entry, Mapping):
        raise TypeError(f"a fault is a {type(entry).__name__}")
    kind = entry["kind"] if entry["kind"] in set(FaultKind) else FaultKind.OTHER
    return Fault(FaultKind(kind), str(entry["text"]), entry.get("frame"))


_COLLECTED: ContextVar[list[Fault] | None] = ContextVar("faults", default=None)


@contextmanager
def collected() -> Iterator[list[Fault]]:
    """Collects the notes of the block, for who reports them; prints them where the block fails."""
    faults: list[Fault] = []
    token = _COLLECTED.set(faults)
    try:
        yield faults
    except BaseException:
        for fault in faults:
            print_message(fault.text)
        raise
    finally:
        _COLLECTED.reset(token)


def note(kind: FaultKind, text: str) -> None:
    """Reports something that is left out. text: one line with the numbers."""
    faults = _COLLECTED.get()
    if faults is None:
        print_message(text)
    else:
        faults.append(Fault(kind, text))


def note_dropped(where: object, reasons: list[str], count: int) -> None:
    """Reports samples that were dropped, with the first reason. count: of all samples."""
    if reasons:
        note(FaultKind.SAMPLES, f"{where}: {len(reasons)} of {count} samples dropped ({reasons[0]})")
