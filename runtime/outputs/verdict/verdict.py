"""The verdict on a map, with reasons and causes: a pure function of run.json and map.json."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import median
from typing import Any, NamedTuple

from edgemap.geometry.camera.floor import FloorNoise
from edgemap.geometry.errors import EdgemapError
from edgemap.geometry.map_object import MapObject
from edgemap.geometry.objects.annotations import LEVELS, Annotations, Level
from edgemap.runtime.frames.errors import RunFolderError
from edgemap.runtime.frames.faults import FaultKind, read_fault
from edgemap.runtime.frames.reading import decode_json, error_line, printable, read_bytes
from edgemap.runtime.motion.odometry_names import HYBRID
from edgemap.runtime.outputs.verdict.causes import CAUSE_OF, CAUSES, Cause

TITLES: dict[Level, str] = {"good": "good", "care": "use with care", "unreliable": "not reliable"}

# Half a metre separates one chair from the next, and what `eval map` counts as the same place; at 3 m, from where
# most objects are seen, 10 degrees are half a metre. Half of either is the end of "good".
WRONG_M, WRONG_DEG = 0.5, 10.0
# A quarter of a drive without a measurement is what no loop closure brings back; a twentieth is a corner or two.
LOST_SHARE, SOME_SHARE = 0.25, 0.05
SHARES = SOME_SHARE, LOST_SHARE
OFF_MOUNT_DEG = 2.0  # of pitch or roll: moves what is 3 m before a lens 0.6 m up by half a metre
SEEN_M = 3.0  # from where most objects are seen; what is nearer than the nearest floor does not show where it stands


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing that lowers the trust in a map. level: care or unreliable. cause: what to do about it. text: what was
    counted, with numbers."""

    level: Level
    cause: Cause
    text: str


@dataclass(frozen=True, slots=True)
class Verdict:
    """level: good, care or unreliable. findings: causes before what follows from them; empty where good."""

    level: Level
    findings: tuple[Finding, ...] = ()

    @property
    def line(self) -> str:
        """The verdict in one line, for a terminal or a headline."""
        shown = "; ".join(finding.text for finding in self.findings[:3])
        return f"map: {TITLES[self.level]}" + (f" ({shown})" if shown else "")

    @property
    def misplaced(self) -> bool:
        """Whether the run was placed wrongly in the saved map that it goes on with."""
        return any(finding.cause is CAUSES["place"] for finding in self.findings)

    def document(self) -> dict[str, Any]:
        """The verdict as plain values, as in run.json."""
        return {"level": self.level, "reasons": [finding.text for finding in self.findings]}

    def on(self, annotations: Annotations) -> Annotations:
        """A map's annotations with this verdict."""
        if annotations.identity is None:
            return annotations
        reasons = tuple(finding.text for finding in self.findings)
        return replace(annotations, identity=replace(annotations.identity, level=self.level, reasons=reasons))


def verdict_of(record: Mapping[str, Any], objects: Sequence[MapObject]) -> Verdict:
    """What a run.json (with its `quality`) and the map's objects show. A record without `quality` has no verdict but
    care."""
    quality = record.get("quality")
    if not isinstance(quality, Mapping) or not quality.get("frames"):
        return Verdict("care", (Finding("care", CAUSES["other"], "the run counted no frames"),))
    run, findings = _Run(record, quality, objects), list[Finding]()
    for checks in CHECKS:
        some = [finding for check in checks for finding in check(run)]
        findings += sorted(some, key=lambda finding: -LEVELS.index(finding.level))
    levels = [LEVELS.index(finding.level) for finding in findings]
    return Verdict(LEVELS[max(levels, default=0)], tuple(findings))


class _Run(NamedTuple):
    """A run.json, its `quality` and the map's objects."""

    record: Mapping[str, Any]
    quality: Mapping[str, Any]
    objects: Sequence[MapObject]

    def faults(self, cause: Cause) -> dict[str, int]:
        """How many faults of each kind have this cause."""
        return {kind: count for kind, count in self.record.get("fault_kinds", {}).items() if kind in cause.kinds}


def _graded(value: float, limits: tuple[float, float], cause: Cause, text: str) -> Iterator[Finding]:
    """A finding where a value is above the first limit, which makes the map unreliable above the second."""
    if value > limits[0]:
        yield Finding("unreliable" if value > limits[1] else "care", cause, text)


def _pictures(run: _Run) -> Iterator[Finding]:
    """Pictures without information."""
    quality = run.quality
    share = quality["blind_frames"] / quality["frames"]
    kinds = ", ".join(sorted(quality.get("blind", {}), key=lambda kind: -quality["blind"][kind]))
    yield from _graded(share, SHARES, CAUSES["light"], f"{100 * share:.0f} % of the pictures are {kinds}")


def _mount(run: _Run) -> Iterator[Finding]:
    """Stated against observed mount, angles and height; and whether it was stated."""
    record, carried = run.record, _is_carried(run)
    given, seen = record.get("mount", {}), record.get("mount_seen", {})
    if guess := record.get("camera_guess"):
        if turned_by := guess.get("turned_by"):
            yield Finding("unreliable", CAUSES["turned"], f"the pictures are not upright: turn them by {turned_by}")
        if sway_deg := guess.get("sway_deg"):
            text = f"the camera sways by {sway_deg:.0f} deg, as in a hand or on a head, and its mount is a guess"
            yield Finding("unreliable", CAUSES["carried"], text)
        focal, height, pitch = guess["focal_sigma_share"], guess["height_sigma_share"], guess.get("sigma_pitch_deg", 0)
        if height and not carried and seen.get("height_m"):
            height = seen["sigma_height_m"] / seen["height_m"]
        parts = [f"focal length to {100 * focal:.0f} %"] if focal else []
        parts += [f"height to {100 * height:.0f} %"] if height else []
        parts += [f"pitch to {pitch:.1f} deg"] if pitch else []
        guessed = [name for name, some in (("lens", focal), ("mount", height or pitch)) if some]
        what = " and ".join(guessed) + " are" if len(guessed) > 1 else f"the {(*guessed, 'camera')[0]} is"
        cause = CAUSES["height_guess" if height else "guess"]
        level: Level = "unreliable" if SEEN_M * height > WRONG_M else "care"
        yield Finding(level, cause, f"{what} guessed ({', '.join(parts)})")
    for angle in ("pitch", "roll"):
        if f"{angle}_deg" not in seen or carried:
            continue
        given_deg, seen_deg = given.get(f"{angle}_deg", 0.0), seen[f"{angle}_deg"]
        used_deg, doubt_deg = seen.get(f"used_{angle}_deg", given_deg), 2.5 * seen[f"sigma_{angle}_deg"]
        if abs(seen_deg - given_deg) > max(OFF_MOUNT_DEG, doubt_deg):
            corrected = abs(used_deg - given_deg) > 0.5 * OFF_MOUNT_DEG
            text = f"the camera's {angle} is {seen_deg:.1f} deg, not {given_deg:.1f} deg"
            text += " (corrected on the way)" if corrected else ""
            yield Finding("care" if corrected else "unreliable", CAUSES["mount"], text)
    if run.faults(CAUSES["scale"]):
        estimate_m = seen.get("height_m")
        but = f", not {given.get('height_m', math.nan):.2f} m as stated" if estimate_m else ""
        text = f"the lens is {estimate_m:.2f} m above the floor{but}" if estimate_m else "the mount's height is wrong"
        yield Finding("unreliable", CAUSES["scale"], text)


def _floor(run: _Run) -> Iterator[Finding]:
    """Whether the camera can see where things stand."""
    record, objects = run.record, run.objects
    lens, mount = record.get("intrinsics", {}), record.get("mount", {})
    if "fy" in lens and "height_m" in mount:
        below = math.atan((lens["height"] - 1.0 - lens["cy"]) / lens["fy"]) + math.radians(mount["pitch_deg"])
        nearest_m = mount["height_m"] / math.tan(below) if below > 0.0 else math.inf
        if mount["height_m"] < SEEN_M:
            text = f"the nearest floor in view is {nearest_m:.1f} m away" if below > 0.0 else "no floor is in view"
            yield from _graded(nearest_m, (SEEN_M, 2.0 * SEEN_M), CAUSES["floor"], text)
    moving = run.quality["frames"] - run.quality.get("still_frames", 0)  # at rest no length is measured
    share = run.quality.get("worktop_frames", 0) / max(moving, 1)
    if _measures_by_floor(run):
        text = (
            f"in {100 * share:.0f} % of the pictures cups, books or the like stand on what is taken for floor: it is a "
            "worktop, and lengths may be twice too long"
        )
        yield from _graded(share, SHARES, CAUSES["worktop"], text)
    if not objects:
        yield Finding("unreliable", CAUSES["floor"], "nothing was mapped")


def _measures_by_floor(run: _Run) -> bool:
    """Whether the floor in the pictures is what gives lengths: neither wheels nor depth nor external poses do."""
    depth = run.record.get("attitude_sources", {}).get("depth", 0)
    measured = depth or run.quality.get("wheel_frames", 0)
    return not measured and run.record.get("odometry", "hybrid") == HYBRID


def _is_carried(run: _Run) -> bool:
    """Whether a person carries the camera, by the guess of it or by its tilt on the way."""
    guess = run.record.get("camera_guess") or {}
    return bool(guess.get("sway_deg")) or run.quality.get("carried_frames", 0) > SOME_SHARE * run.quality["frames"]


def _motion(run: _Run) -> Iterator[Finding]:
    """The uncertainty of the pose, and its causes."""
    record, quality = run.record, run.quality
    frames, alone = quality["frames"], str(record.get("odometry", "")).startswith("wheel:")
    by_file = frames - quality["guessed_frames"] - quality.get("camera_frames", 0)
    wheels = by_file if alone else quality.get("wheel_frames", 0)
    cause = CAUSES["drift"] if wheels > 0.5 * frames else CAUSES["carried" if _is_carried(run) else "wheels"]
    moving = frames - quality.get("still_frames", 0) - 1
    if (alone or quality.get("wheels", wheels > 0)) and wheels < (1.0 - SOME_SHARE) * moving:
        cause, share = CAUSES["wheels"], 1.0 - wheels / moving
        if run.faults(CAUSES["scale"]):
            cause = CAUSES["scale"]  # beside a camera of the wrong height, wheels that are right are left out
        yield Finding("care", cause, f"{100 * share:.0f} % of the frames in motion have no wheel odometry")
    guessed = quality["guessed_frames"] / frames
    yield from _graded(guessed, SHARES, cause, f"the motion of {100 * guessed:.0f} % of the frames is a guess")
    sigma_m, heading = quality["sigma_m"]["end"], quality["heading_sigma_deg"]["end"]
    known = "the heading is unknown" if heading > 90.0 else f"{heading:.0f} deg"
    wrong = max(sigma_m / WRONG_M, heading / WRONG_DEG)
    yield from _graded(wrong, (0.5, 1.0), cause, f"the pose is known to {sigma_m:.2f} m and {known}")


def _camera(run: _Run) -> Iterator[Finding]:
    """A camera unlike those that the map was tested with."""
    if run.quality.get("carried_frames", 0) > SOME_SHARE * run.quality["frames"]:
        yield Finding("care", CAUSES["carried"], "the camera sways as in a hand or on a head")
    rate = run.quality.get("rate_hz")
    # At 0.5 m/s and 60 degrees/s a picture of 4 Hz shares three quarters of its view with the one before.
    if rate is not None and rate < 4.0:
        yield Finding("care", CAUSES["rate"], f"{rate:.1f} pictures per second")


CONTRADICTED = {
    FaultKind.POSES_EXCLUDED: "the poses contradict the camera",
    FaultKind.WHEELS_EXCLUDED: "the wheels contradict the camera",
    FaultKind.POSES_CONVERTED: "the poses' axes, order or units were found out, not stated",
    FaultKind.DEPTH_EXCLUDED: "depth contradicts the floor",
    FaultKind.IMU_EXCLUDED: "the IMU was wrong for a time",
}


def _sources(run: _Run) -> Iterator[Finding]:
    """Sensors and poses that contradict the camera: up to the fault that left them out, the map rests on them."""
    carries = not str(run.record.get("odometry", "hybrid")).startswith("hybrid")
    for kind, text in CONTRADICTED.items():
        wheels = kind is FaultKind.WHEELS_EXCLUDED
        if run.record.get("fault_kinds", {}).get(kind) and (carries or not wheels):
            level: Level = "unreliable" if wheels or kind is FaultKind.POSES_EXCLUDED else "care"
            yield Finding(level, CAUSES["sources"], text)


def _objects(run: _Run) -> Iterator[Finding]:
    """How sure the map is of its objects."""
    record, objects = run.record, run.objects
    if not objects:
        return
    if twice := run.quality.get("doubled"):
        text = f"{twice['objects']} objects stand twice, {twice['away_m']:.1f} m and {twice['turned_deg']:.0f} deg off"
        yield Finding("unreliable", CAUSES["place"], f"{text}: the robot was placed wrongly in the map")
    doubtful = sum(is_doubtful(item) for item in objects) / len(objects)
    text = f"{100 * doubtful:.0f} % of the objects are doubtful"
    yield from _graded(doubtful, (LOST_SHARE, 2.0 * LOST_SHARE), CAUSES["other"], text)
    typical_m, height_m = median(sigma_of(item) for item in objects), record.get("mount", {}).get("height_m", math.inf)
    # An uncertain tilt alone moves objects that far.
    is_low = FloorNoise().tilt_rad * SEEN_M**2 > 0.5 * WRONG_M * height_m
    low = f", with a lens {height_m:.2f} m above the floor" if is_low else ""
    text = f"the objects' positions are known to {typical_m:.2f} m{low}"
    yield from _graded(typical_m, (0.5 * WRONG_M, WRONG_M), CAUSES["low" if low else "other"], text)


def _camera_faults(run: _Run) -> Iterator[Finding]:
    """A camera that did not deliver its pictures in order."""
    counts = run.faults(CAUSES["device"])
    if counts:
        kinds = ", ".join(f"{kind} {count}" for kind, count in counts.items())
        yield Finding("care", CAUSES["device"], f"faults of the camera: {kinds}")


# Causes before what follows from them: what the camera shows and how it sits, then the motion, then the map.
CHECKS = ((_pictures, _mount, _floor, _camera_faults, _sources), (_motion, _camera), (_objects,))


def is_doubtful(item: MapObject) -> bool:
    """Whether an object is doubtful: no person has confirmed it, and its confidence is below a half or its position
    uncertain by more than half a metre.
    """
    return not item.confirmed and (item.confidence < 0.5 or sigma_of(item) > WRONG_M)


def sigma_of(item: MapObject) -> float:
    """Standard deviation of an object's position, metres: root mean square over both axes."""
    return math.sqrt(max(float(item.covariance_m2[0, 0] + item.covariance_m2[1, 1]) / 2.0, 0.0))


@dataclass(frozen=True, slots=True)
class Step:
    """One cause with its evidence. counted: whether the verdict rests on it, or faults alone name it."""

    cause: Cause
    evidence: tuple[str, ...]
    counted: bool


def explain(record: Mapping[str, Any], objects: Sequence[MapObject]) -> tuple[Verdict, list[Step]]:
    """The verdict and its causes, the gravest first; those that faults alone name come last. Raises RunFolderError
    where fields of the record are of other types.
    """
    try:
        verdict, faults = verdict_of(record, objects), list(map(read_fault, record.get("faults", [])))
    except (LookupError, TypeError, ValueError, AttributeError, ArithmeticError) as error:
        raise RunFolderError(f"run.json: damaged, or of another version ({error_line(error)})") from None
    evidence: dict[Cause, list[str]] = {}
    for finding in verdict.findings:
        evidence.setdefault(finding.cause, []).append(finding.text)
    shown: dict[Cause, list[str]] = {}
    for fault in faults:
        if cause := CAUSE_OF.get(fault.kind):
            shown.setdefault(cause, []).append(printable(fault.line))
    counted = set(evidence)
    for cause, lines in shown.items():
        evidence.setdefault(cause, []).extend(lines[:3])  # more say the same
    return verdict, [Step(cause, tuple(dict.fromkeys(lines)), cause in counted) for cause, lines in evidence.items()]


def read_record(path: Path) -> dict[str, Any]:
    """A run.json. Raises RunFolderError."""
    return decode_json(read_bytes(path, RunFolderError), dict, path, RunFolderError)


def verdict_or_none(record: Mapping[str, Any], objects: Sequence[MapObject]) -> Verdict | None:
    """The verdict of a record that may be of an older edgemap, or damaged; None where it cannot be judged."""
    try:
        return explain(record, objects)[0]
    except EdgemapError:
        return None
