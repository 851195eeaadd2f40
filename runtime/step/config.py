"""The configuration tree: every tuned number of the step under one name, as YAML, in run.json, and back."""

from dataclasses import dataclass, field, fields, is_dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import msgspec

from edgemap.geometry.errors import EdgemapError
from edgemap.geometry.grid.rule import GridRule
from edgemap.geometry.objects.association import AssociationRule
from edgemap.geometry.objects.forgetting import ForgetRule
from edgemap.geometry.observations.sighting import FloorRule
from edgemap.geometry.registration.alignment import AlignmentRule
from edgemap.geometry.slam.pose_graph import GraphRule
from edgemap.runtime.frames.plain_yaml import read_yaml
from edgemap.runtime.frames.reading import Strict, convert, decode_json, one_line, read_bytes
from edgemap.runtime.inputs.budget import Effort
from edgemap.runtime.inputs.cameras.supervisor import RecoveryRule
from edgemap.runtime.motion.attitude.inertial import AttitudeRule
from edgemap.runtime.motion.health import HealthRule
from edgemap.runtime.motion.height_check import HeightRule
from edgemap.runtime.motion.odometry import OdometryRules
from edgemap.runtime.motion.rest import RestRule

MAX_BYTES = 16 << 20  # of a configuration file: a run.json may carry a long list of faults
DERIVED = {"floor": ("mapped", "full_weight_score")}  # of the bundle and of --classes, never tuned
# Names that files of before 2026-11-22 use, by part of the tree: their values are taken under today's.
RENAMED = {
    "rest": {"told_s": "confirmed_s", "seen_s": "pictures_s"},
    "forgetting": {
        "surest": "highest",
        "gone": "lowest",
        "look_m": "same_m",
        "look_rad": "same_rad",
        "look_frames": "same_frames",
        "prior_looks": "prior_observations",
    },
}
SCALED = ("flow", "planar", "gyro", "outside_flow", "outside_planar")  # members of the hybrid
# Numbers of earlier files that nothing uses any more, passed over.
RETIRED = {
    "camera": ("stall_intervals", "retries", "reset_every", "back_off_limit_s", "settle_s"),
    "attitude": (
        "offset_rad",
        "judged_s",
        "steady_rad",
        "wrong_rad",
        "farthest_rad",
        "nodding_s",
        "swings_rad_s",
    ),
    "association": (
        "gate",
        "max_distance_m",
        "correlated",
        "systematic_m",
        "systematic_extent_share",
        "maximum_pools",
        "budget",
        "still_m",
        "grown",
        "min_confidence",
    ),
    "overlap": ("rare_label", "rare", "correlated"),
    "loop_closure": (
        "residual",
        "view_m",
        "merged_m",
        "repeated",
        "track",
        "views",
        "doubt",
        "kernel",
        "minimum",
        "nearest",
        "gate",
    ),
    "keyframes": (
        "stated_inflation_yaw",
        "stated_per_radian",
        "keyframe_rad",
        "inflation",
        "per_metre",
        "per_radian",
        "still_m",
        "still_rad",
        "path_gain",
        "yaw_gain",
        "exact_m",
        "exact_rad",
    ),
    "landmarks": ("gate", "side_m"),
    "grid": ("coarsest_row_m", "scan_rad", "patch_rad"),
    "hypotheses": ("gate", "maximum_now", "maximum_hypotheses", "nodes"),
    "odometry": ("scale",),
    "check": (
        "road_rad",
        "strip_s",
        "steady_s",
        "gravity_rad",
        "first_s",
        "fewest",
        "steady_rad",
        "turn_rad",
        "turn_s",
        "gravity_s",
        "sigmas",
        "sure_rad",
        "used_rad",
        "follow_rad",
        "judge_every_s",
        "told_s",
    ),
    "tilt": ("edges", "drift", "gravity", "depth", "gate"),
    "carried": ("calm_s",),
    "coasting": ("carried_s",),
    "flow": ("keyframe_s",),
    "height": ("every_s", "loose", "sigmas", "wrong_depth_share"),
    "rest": ("frames", "sigmas", "offset", "changed"),
    "wheels": ("per_metre", "per_radian", "still_m", "still_rad", "roughness_rad"),
    "noise": (
        "start_accel",
        "speed_s",
        "rest_speed",
        "rest_yaw",
        "rest_accel",
        "start_speed",
        "rest_bias",
        "risen",
        "gap",
        "lost_s",
    ),
    "compass": ("alike_rad", "lost_rad", "kept_s", "settle_gyro_s", "fastest_m_s"),
    "depth": (
        "refined_px",
        "corners_apart_px",
        "valid",
        "lost",
    ),
    "health": (
        "repeated_s",
        "blown",
        "frozen_s",
        "part_every_s",
        "part_s",
        "part_still",
        "part_lasts_s",
        "part_sudden",
    ),
    "hybrid": (
        *(f"{name}_covariance_scale" for name in SCALED),
        *(f"{name}_doubt" for name in SCALED),
        "lasting_covariance_scale",
        "flow_reach_rad",
        "flow_movers_scale",
        "movers_share",
        "covered_share",
        "flow_alone_s",
        "gate",
        "known_sigma",
        "repeated_s",
        "gyro_gate",
        "wheels_covariance_scale",
        "wheels_doubt",
    ),
    "trust": ("yaw", "yaw_between", "length_between", "sigmas"),
    "pictures": ("alone", "reach_sigmas", "lasting_rad", "reach_rad"),
    "planar": (
        "corners_apart_px",
        "scaled",
        "lateral_m",
        "slides_share",
        "slides_weight",
        "neighbour_px",
        "axle_sigma_m",
        "nodding_sigmas",
        "shift_least_px",
        "floor_probability",
        "max_scale_drift",
        "longest_gap_s",
        "mover_margin_px",
        "unknown_axle_m",
        "unseen_speed_m_s",
        "travelled_fewest",
        "gyro_tilt",
        "gyro_upright_rad",
        "gyro_levelling",
        "gyro_floor",
        "scale_kept_s",
        "floor_lost_s",
    ),
}


class ConfigError(EdgemapError):
    """A configuration file that cannot be used."""


@dataclass(frozen=True, slots=True)
class Config:
    """The step's tuned numbers by stage; each class documents meaning, unit and reason of its own.

    floor: boxes to observations. association, registration, forgetting: the map's objects. loop_closure: keyframes,
    landmarks and loop hypotheses. odometry: planar landmarks, wheels, hybrid, coasting. camera: when a live one is
    opened again. health: of pictures. rest: when a robot stands. attitude: gravity and gyro against the mount.
    height: of the lens, by sizes, wheels and depth. grid: free and occupied floor.
    """

    floor: FloorRule = field(default_factory=FloorRule)
    association: AssociationRule = field(default_factory=AssociationRule)
    loop_closure: GraphRule = field(default_factory=GraphRule)
    forgetting: ForgetRule = field(default_factory=ForgetRule)
    registration: AlignmentRule = field(default_factory=AlignmentRule)
    odometry: OdometryRules = field(default_factory=OdometryRules)
    camera: RecoveryRule = field(default_factory=RecoveryRule)
    health: HealthRule = field(default_factory=HealthRule)
    rest: RestRule = field(default_factory=RestRule)
    attitude: AttitudeRule = field(default_factory=AttitudeRule)
    height: HeightRule = field(default_factory=HeightRule)
    grid: GridRule = field(default_factory=GridRule)


def config_document(config: Config) -> dict[str, Any]:
    """The resolved tree as plain values, without the bundle's own settings."""
    document = msgspec.to_builtins(config)
    for part, names in DERIVED.items():
        for name in names:
            del document[part][name]
    return document


def load_config(path: Path) -> tuple[Config, dict[str, Any]]:
    """The tree and the command line's options that a YAML file or a run.json gives.

    A YAML file has two sections, both optional: `options` (the flags of `edgemap run` without dashes) and `config` (any
    part of the tree). Raises ConfigError in one line that names the value.
    """
    path = _file(path)
    document = _run_json(path) if path.suffix == ".json" else read_yaml(path, ConfigError)
    if not isinstance(document, dict) or not ({"config", "options"} & document.keys()):
        raise ConfigError(f"{path}: has neither a section `config` nor `options`")
    options = document.get("options") or {}
    if not isinstance(options, dict):
        raise ConfigError(f"{path}: options is a {type(options).__name__}, not a mapping of flags")
    return _merged(Config(), document.get("config") or {}, f"{path}: config"), options


def load_efforts(path: Path) -> list[Effort]:
    """The decisions of a budget in the run of a run.json, in order; none for a YAML file. Raises ConfigError."""
    path = _file(path)
    if path.suffix != ".json":
        return []
    rows = convert(_run_json(path).get("efforts", []), list[_Effort], f"{path}: efforts", ConfigError)
    return [Effort(**msgspec.structs.asdict(row)) for row in rows]


def _file(path: Path) -> Path:
    """A run folder's run.json; a file as it is."""
    return path / "run.json" if path.is_dir() else path


def _run_json(path: Path) -> dict[str, Any]:
    return decode_json(read_bytes(path, MAX_BYTES, ConfigError), dict, path, ConfigError)


class _Effort(Strict):
    since: Annotated[int, msgspec.Meta(ge=0, le=1 << 53)]
    search_every: Annotated[int, msgspec.Meta(ge=1, le=1000)]
    take_every: Annotated[int, msgspec.Meta(ge=1, le=1000)]


def _merged(default: Any, given: Any, where: str) -> Any:
    """A dataclass with the values that a document gives, checked field by field."""
    if not isinstance(given, dict):
        raise ConfigError(f"{where} is {_shown(given)}, not a mapping")
    known = {item.name for item in fields(default)}
    part = where.rpartition(".")[2]
    derived, renamed = DERIVED.get(part, ()), RENAMED.get(part, {})
    changed: dict[str, Any] = {}
    for key, value in given.items():
        if key in RETIRED.get(part, ()):
            continue
        here, name = f"{where}.{one_line(key, 40)}", renamed.get(key, key)
        if name in changed:
            raise ConfigError(f"{here}: {name} is given twice, by this name and by its old one")
        if name not in known or name in derived:
            raise ConfigError(f"{here} is unknown (known: {', '.join(sorted(known - set(derived)))})")
        before = getattr(default, name)
        changed[name] = _merged(before, value, here) if is_dataclass(before) else _number(before, value, here)
    return replace(default, **changed)


def _number(before: Any, value: Any, where: str) -> Any:
    """A value of the default's own type."""
    try:
        number = msgspec.convert(value, type(before), strict=True)
    except msgspec.ValidationError:
        raise ConfigError(f"{where} is {_shown(value)}, not a {type(before).__name__}") from None
    if isinstance(number, float) and not abs(number) < 1e12:
        raise ConfigError(f"{where} is {_shown(value)}, not a finite number")
    return number


def _shown(value: Any) -> str:
    return f"a {type(value).__name__}" if isinstance(value, dict | list) else one_line(repr(value), 60)
