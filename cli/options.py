"""Options that several commands share: what they mean, and how their text is read. No heavy imports here."""

import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from edgemap.cli.arguments import arg
from edgemap.runtime.frames.errors import UsageError
from edgemap.runtime.frames.option_texts import words_of

if TYPE_CHECKING:
    from edgemap.runtime.frames.camera import SensorTopics
    from edgemap.runtime.network.bundle import Bundle


BundleName = Annotated[
    str | None,
    arg(
        metavar="NAME|DIR",
        help="The model: a bundle folder, or a name of the package or the cache (pulled when it is in neither). By "
        "default edgemap-nano for rendered pictures (demo, sim:, simulate), edgemap-pico for those of a real camera.",
    ),
]
WithoutImu = Annotated[
    bool, arg(help="Ignore the inertial samples of the source: roll and pitch come from pictures, yaw without a gyro.")
]
WithoutDepth = Annotated[bool, arg(help="Ignore the depth pictures of the source.")]
Topics = Annotated[
    str | None,
    arg(
        metavar="KIND=/TOPIC,…",
        help="Further sensors, topics of the recording or live ROS 2 ones (docs/ros2.md): wheels=/TOPIC "
        "(nav_msgs/Odometry), imu=/TOPIC (sensor_msgs/Imu; tf must join its frame to the camera's), depth=/TOPIC "
        "(aligned with the pictures; by default .../aligned_depth_to_color/...), optical=FRAME (the camera's in tf).",
    ),
]
Confidence = Annotated[
    float | None,
    arg(
        metavar="0..1", help="Minimum score of a box (objectness times class probability); by default the bundle's own."
    ),
]
ConfigFile = Annotated[
    Path | None,
    arg(
        name="config",
        metavar="FILE",
        help="A YAML file or a run.json: its tuned numbers.",
    ),
]
ConfigOptions = Annotated[
    bool,
    arg(
        help="With --config: the file's options as well (camera, out, outputs …), but those that are typed; each is "
        "printed. A run.json with both makes the same run again. For files that you trust."
    ),
]


def listed(text: str | None) -> list[str]:
    """The names in `A,B`."""
    return [name.strip() for name in (text or "").split(",") if name.strip()]


def sensor_topics(text: str | None, optical: str = "camera_optical_frame") -> "SensorTopics":
    """The sensors in the text of `--topics`. optical: the camera's frame where the text names none. Raises
    UsageError."""
    from edgemap.runtime.frames.camera import SensorTopics

    words = words_of(text or "", "--topics", {"wheels", "imu", "depth", "optical"})
    return SensorTopics(**{"optical": optical, **words})


Json = Annotated[bool, arg(help="Print one JSON document on standard output and nothing else.")]


def print_json(document: object, allow_nan: bool = True) -> None:
    """What `--json` prints. Raises ValueError for a number that is none, where that is not allowed."""
    import json

    print(json.dumps(document, indent=1, allow_nan=allow_nan))


def figure(value: float | None, form: str = ".2f", unit: str = "") -> str:
    """A number for a table, or a dash as wide where there is none."""
    return f"{'–':>{len(format(0.0, form))}}" if value is None else f"{value:{form}}{unit}"


def at_least(minimum: int, **values: int | None) -> None:
    """Rejects integers below `minimum`; keywords are option names, None is accepted. Raises UsageError."""
    _check(values, lambda value: value >= minimum, f"{minimum} or more")


def above_zero(**values: float | None) -> None:
    """Rejects numbers that are not positive and finite, as `at_least` does."""
    _check(values, lambda value: 0.0 < value < math.inf, "above 0")


def in_unit(**values: float | None) -> None:
    """Rejects numbers outside (0, 1], as `at_least` does."""
    _check(values, lambda value: 0.0 < value <= 1.0, "above 0 and at most 1")


def _check(values: Mapping[str, float | None], fits: Callable[[float], bool], expected: str) -> None:
    for name, value in values.items():
        if value is not None and not fits(value):
            raise UsageError(f"--{name.replace('_', '-')} {value:g}: must be {expected}")


def minimum_score(confidence: float | None, bundle: "Bundle") -> float:
    """The asked for confidence, else the bundle's own. Raises UsageError outside 0..1."""
    in_unit(confidence=confidence)
    return bundle.manifest.confidence if confidence is None else confidence


def last_run() -> Path:
    """The newest run folder in `runs/` or here, by the time of its run.json. Raises UsageError where there is none."""
    found = [path for pattern in ("runs/*/run.json", "*/run.json") for path in Path().glob(pattern) if path.is_file()]
    if not found:
        raise UsageError("no run in runs/ or here: give a map.json or a run folder, or make one with `edgemap run`")
    return max(found, key=lambda path: path.stat().st_mtime).parent
