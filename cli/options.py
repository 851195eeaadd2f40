"""Options that several commands share: what they mean, and how their text is read. No heavy imports here."""

import math
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from edgemap.cli.arguments import OptionError, arg

if TYPE_CHECKING:
    from edgemap.runtime.frames.decisions import Decisions, Precision
    from edgemap.runtime.network.bundle import Bundle
    from edgemap.runtime.network.compute import EngineChoice, Pace

from edgemap.runtime.frames.extras import need

PICTURE_ODOMETRIES = ("hybrid", "flow", "planar", "window")  # lengths are in proportion to the height of the lens
ODOMETRIES = (*PICTURE_ODOMETRIES, "gyro", "paper", "truth")
MAXIMUM_THREADS = 64

BundleName = Annotated[
    str | None,
    arg(
        metavar="NAME|DIR",
        help="The model: a bundle folder, or a name of the package or the cache (pulled when it is in neither). By "
        "default edgemap-nano for rendered pictures (demo, sim:, drive:), edgemap-pico for those of a real camera.",
    ),
]
OdometrySpec = Annotated[
    str,
    arg(
        metavar="SPEC",
        help="Where the robot's motion comes from: hybrid (flow, planar, and gyro and wheels where the source brings "
        "them); flow (a network on the backbone's features); planar (floor corners); window (the same, "
        "keyframes of a carried camera optimised together); gyro; truth (the drive's own "
        "poses); paper (the bundle's ConvLSTM head); wheel:FILE.csv (stamp_s,x_m,y_m,yaw_rad) or wheel:FILE.mcap; "
        "FILE.tum (poses of the base).",
    ),
]
WithoutWheels = Annotated[bool, arg(help="Ignore the wheel odometry of the source.")]
WithoutImu = Annotated[
    bool, arg(help="Ignore the inertial samples of the source: roll and pitch come from pictures, yaw without a gyro.")
]
WithoutDepth = Annotated[bool, arg(help="Ignore the depth pictures of the source.")]
Confidence = Annotated[
    float | None,
    arg(
        metavar="0..1", help="Minimum score of a box (objectness times class probability); by default the bundle's own."
    ),
]
Threads = Annotated[
    int | None,
    arg(metavar="N", help="Threads of the backbone; by default one or two, whichever a short trial finds faster."),
]
PrecisionName = Annotated[
    Literal["default", "float32", "int8", "auto"],
    arg(
        help="Numbers that the backbone computes with. default: what a recording was made with, else float32; int8: "
        "the bundle's variant of 8-bit numbers, where it has one; auto: that one where its report loses at most 0.01 "
        "AP50 and a short trial finds it faster on this processor.",
    ),
]
EngineName = Annotated[
    Literal["default", "onnxruntime", "openvino", "openvino-bf16", "auto"],
    arg(
        help="What runs the backbone. default: what a recording was made with, else onnxruntime; openvino (extra "
        "openvino) computes with 32 bits as well, openvino-bf16 with 16 where the processor has them; auto: the "
        "one of these that a trial finds clearly fastest, remembered."
    ),
]
LoopClosure = Annotated[
    bool,
    arg(
        help="Leave the pose to odometry when objects are observed again. Always so where poses are given (truth, "
        "FILE.tum) and with --clustering paper."
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
Json = Annotated[bool, arg(help="Print one JSON document on standard output and nothing else.")]


def print_json(document: object, allow_nan: bool = True) -> None:
    """What `--json` prints. Raises ValueError for a number that is none, where that is not allowed."""
    import json

    print(json.dumps(document, indent=1, allow_nan=allow_nan))


def numbers(text: str, option: str, names: str) -> list[float]:
    """Comma-separated finite numbers, as many as there are names. Raises OptionError."""
    try:
        values = [float(part) for part in text.split(",")]
    except ValueError:
        values = []
    if len(values) != len(names.split(",")):
        raise OptionError(f"{option} {text!r}: expected {len(names.split(','))} numbers, {names}")
    if not all(map(math.isfinite, values)):
        raise OptionError(f"{option} {text!r}: {names} must be finite numbers")
    return values


def at_least(minimum: int, **values: int | None) -> None:
    """Rejects integers below `minimum`; keywords are option names, None is accepted. Raises OptionError."""
    for name, value in values.items():
        if value is not None and value < minimum:
            raise OptionError(f"--{name} {value}: must be {minimum} or more")


def in_unit(**values: float | None) -> None:
    """Rejects numbers outside (0, 1]; keywords are option names, None is accepted. Raises OptionError."""
    for name, value in values.items():
        if value is not None and not 0.0 < value <= 1.0:
            raise OptionError(f"--{name} {value}: must be above 0 and at most 1")


def minimum_score(confidence: float | None, bundle: "Bundle") -> float:
    """The asked for confidence, else the bundle's own. Raises OptionError outside 0..1."""
    in_unit(confidence=confidence)
    return bundle.manifest.confidence if confidence is None else confidence


def check_odometry(spec: str) -> None:
    """Refuse a SPEC that names no odometry. Raises OptionError with the one that is meant."""
    if spec in ODOMETRIES or spec.startswith("wheel:") or spec.endswith(".tum"):
        return
    from difflib import get_close_matches

    close = get_close_matches(spec.casefold(), [*ODOMETRIES, "wheel"], 1, 0.6)
    meant = "wheel:FILE.csv" if close == ["wheel"] else next(iter(close), None)
    hint = f"did you mean {meant}? Known are" if meant else "expected"
    raise OptionError(f"--odometry {spec!r}: {hint} {', '.join(ODOMETRIES)}, wheel:FILE.csv|.mcap or FILE.tum")


def find_bundle(
    name: str | None,
    threads: int | None,
    precision: "Precision | Literal['default']" = "default",
    *specs: str,
    pace: "Pace" = "files",
    engine: "EngineChoice | Literal['default']" = "default",
    recorded: "Decisions | None" = None,
) -> "Bundle":
    """Load a bundle by folder or name; a listed name that is not in the cache is pulled first. specs: the sources of
    the run, which select the default bundle; standard error then names it with the reason. recorded: engine and
    precision of the run that made a recording, taken where none is asked for.
    """
    at_least(1, threads=threads)
    if threads is not None and threads > MAXIMUM_THREADS:
        raise OptionError(f"--threads {threads}: at most {MAXIMUM_THREADS}")
    from edgemap.runtime.frames.reading import print_message
    from edgemap.runtime.network.bundle import load_bundle
    from edgemap.runtime.network.store import bundle_folder, default_bundle, passed_over, shipped_bundles

    if name is None:
        name, reason = default_bundle(*specs)
        print_message(f"bundle {name}: {reason}")
    folder = bundle_folder(name)
    if (other := passed_over(name)) is not None:
        print_message(f"bundle {name}: the one that comes with edgemap, not another of its name (--bundle {other})")
    if folder.suffix == ".onnx" or folder.is_file():
        made = folder.stem
        raise OptionError(
            f"--bundle {name}: a bundle is a folder with a contract; make one of this file with "
            f"edgemap export --backbone {name} -o {made}, then pass --bundle {made}"
        )
    if not (folder / "bundle.json").is_file() and not Path(name).exists():
        from edgemap.cli.pull import KNOWN, pull_known

        if name not in KNOWN:
            shipped = shipped_bundles()
            hint = known_names([name], [*shipped, *KNOWN], "")
            hint = hint if hint.startswith("did") else "no such bundle."
            raise OptionError(
                f"--bundle {name}: {hint} The package has {', '.join(shipped)}; edgemap pull fetches "
                f"{', '.join(sorted(set(KNOWN) - set(shipped)))}; or give a bundle's folder"
            )
        folder = pull_known(name)
    return load_bundle(
        folder, threads, chosen_precision(precision, recorded), pace=pace, engine=chosen_engine(engine, recorded)
    )


def chosen_precision(asked: "Precision | Literal['default']", recorded: "Decisions | None" = None) -> "Precision":
    """The requested precision, else the recorded one, else float32."""
    if asked != "default":
        return asked
    return recorded.precision if recorded else "float32"


def chosen_engine(asked: "EngineChoice | Literal['default']", recorded: "Decisions | None" = None) -> "EngineChoice":
    """The requested engine, else the recorded one if it is installed, else onnxruntime."""
    from importlib.util import find_spec

    from edgemap.runtime.frames.reading import print_message

    if asked != "default":
        return asked
    if recorded and recorded.engine != "onnxruntime" and find_spec("openvino") is None:
        print_message(f"recorded with {recorded.engine}, which is not installed: the map may differ slightly")
        return "onnxruntime"
    return recorded.engine if recorded else "onnxruntime"


def choose_classes(text: str | None, bundle: "Bundle") -> frozenset[str]:
    """`--classes chair,couch`: the bundle's classes to map, instead of the household classes. Raises OptionError."""
    if text is None:
        return bundle.mapped
    chosen = frozenset(name.strip() for name in text.split(",") if name.strip())
    if unknown := sorted(chosen - set(bundle.names)):
        raise OptionError(f"--classes {', '.join(unknown)}: {known_names(unknown, bundle.names, 'the bundle knows')}")
    if not chosen:
        raise OptionError("--classes is empty")
    return chosen


def known_names(unknown: Iterable[str], known: Iterable[str], whose: str) -> str:
    """A hint for unknown names: similar valid names, or else all valid ones."""
    from difflib import get_close_matches

    names = sorted(set(known))
    lower = {name.casefold(): name for name in names}
    meant = [lower[close[0]] for name in unknown if (close := get_close_matches(name.casefold(), lower, 1, 0.75))]
    return f"did you mean {', '.join(meant)}?" if meant else f"{whose} {', '.join(names) or 'none'}"


def need_export(command: str = "edgemap export") -> None:
    """Raise MissingExtraError where torch, onnx or onnxscript cannot be imported."""
    need("export", command, ("torch", "onnx", "onnxscript"))


def need_training(command: str) -> None:
    """Raises MissingExtraError where torch or onnx, which training needs, cannot be imported."""
    need("export", command, ("torch", "onnx"))


def need_simulation(command: str = "edgemap simulate") -> None:
    """Raise MissingExtraError where the renderer, the light baker or the picture reader cannot be imported."""
    need("simulation", command, ("moderngl", "embreex", "PIL"))


def last_run() -> Path:
    """The newest run folder in `runs/`, by the time of its run.json. Raises OptionError where there is none."""
    found = [path for path in Path("runs").glob("*/run.json") if path.is_file()]
    if not found:
        raise OptionError("no run in runs/: give a map.json or a run folder, or make one with `edgemap run`")
    return max(found, key=lambda path: path.stat().st_mtime).parent
