"""The configuration tree: every tuned number of the step under one name, as YAML, in run.json, and back."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import msgspec

from edgemap.geometry.errors import EdgemapError, GeometryError
from edgemap.geometry.grid.occupancy_grid import GridRule
from edgemap.geometry.objects.association import AssociationRule
from edgemap.geometry.objects.forgetting import ForgetRule
from edgemap.geometry.observations.sighting import FloorRule
from edgemap.geometry.registration.alignment import AlignmentRule
from edgemap.geometry.slam.pose_graph import GraphRule
from edgemap.runtime.frames.camera import RecoveryRule
from edgemap.runtime.frames.reading import convert, decode_json, one_line, print_message, read_bytes
from edgemap.runtime.frames.yaml_file import read_yaml
from edgemap.runtime.motion.attitude.inertial import AttitudeRule
from edgemap.runtime.motion.health import HealthRule
from edgemap.runtime.motion.height_check import HeightRule
from edgemap.runtime.motion.odometry import OdometryRules
from edgemap.runtime.motion.rest import RestRule


class ConfigError(EdgemapError):
    """A configuration file that cannot be used."""


@dataclass(frozen=True, slots=True)
class Config:
    """The step's tuned numbers by stage; each class documents meaning, unit and reason.

    floor: boxes to observations. association, registration, forgetting: the map's objects. loop_closure: keyframes,
    landmarks and loop hypotheses. odometry: planar landmarks, wheels, hybrid, coasting. camera: when a live one is
    opened again. health: of pictures. rest: when a robot stands. attitude: gravity and gyro against the mount. height:
    of the lens, by sizes, wheels and depth. grid: free and occupied floor.
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


def load_config(path: Path) -> Config:
    """The tree that a YAML file or a run.json gives, by its section `config` (any part of the tree).

    Numbers of a run's run.json that this version does not have are passed over and printed, as another version wrote
    them. Raises ConfigError in one line that names the value.
    """
    path, document = _document(path)
    where, values = f"{path}: config", document.get("config") or {}
    unknown = list(_unknown(msgspec.to_builtins(Config()), values, where))
    if unknown and not str(document.get("format", "")).startswith("edgemap.run/"):
        raise ConfigError("{} is unknown (known: {})".format(*unknown[0]))
    if unknown:
        names = ", ".join(where.removeprefix(f"{path}: config.") for where, _ in unknown)
        print_message(f"{path}: {len(unknown)} numbers of another version passed over: {one_line(names)}")
    try:
        return convert(values, Config, where, ConfigError)
    except GeometryError as error:
        raise ConfigError(f"{where}: {error}") from None


def load_options(path: Path) -> dict[str, Any]:
    """The command line's options of a YAML file or a run.json, its section `options`: the flags of `edgemap run`
    without dashes. Raises ConfigError."""
    path, document = _document(path)
    options = document.get("options") or {}
    if not isinstance(options, dict):
        raise ConfigError(f"{path}: options is a {type(options).__name__}, not a mapping of flags")
    return options


def _document(path: Path) -> tuple[Path, dict[str, Any]]:
    """The file (a run folder's is its run.json), and its content with at least one of its two sections."""
    path = path / "run.json" if path.is_dir() else path
    is_json = path.suffix == ".json"
    document = (
        decode_json(read_bytes(path, ConfigError), dict, path, ConfigError) if is_json else read_yaml(path, ConfigError)
    )
    if not isinstance(document, dict) or not ({"config", "options"} & document.keys()):
        raise ConfigError(f"{path}: has neither a section `config` nor `options`")
    return path, document


def _unknown(defaults: dict[str, Any], values: Any, where: str) -> Iterator[tuple[str, str]]:
    """Each name in a document's part of the tree that the defaults do not have, with those that they have. Raises
    ConfigError for a number that no field may have."""
    for key, value in values.items() if isinstance(values, dict) else ():
        here, part, is_number = f"{where}.{one_line(key, 40)}", defaults.get(key), isinstance(value, int | float)
        if key not in defaults:
            yield here, ", ".join(sorted(defaults))
        elif is_number and not abs(value) < 1e12:
            raise ConfigError(f"{here} is {value}, not a finite number")
        elif is_number and isinstance(part, int | float) and value < 0 <= part:
            raise ConfigError(f"{here} is {value}: must not be negative")
        elif isinstance(part, dict):
            yield from _unknown(part, value, here)
