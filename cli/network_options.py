"""The network of a command and what runs it. No heavy imports here."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from edgemap.cli.arguments import OptionError, arg
from edgemap.cli.options import BundleName, at_least, known_names

if TYPE_CHECKING:
    from edgemap.runtime.frames.decisions import Decisions, Precision
    from edgemap.runtime.network.bundle import Bundle
    from edgemap.runtime.network.compute import EngineChoice, Pace

MAXIMUM_THREADS = 64


@dataclass(frozen=True)
class NetworkOptions:
    """The network and what runs it."""

    bundle: BundleName = None
    threads: Annotated[
        int | None,
        arg(metavar="N", help="Threads of the backbone; by default one or two, whichever a short trial finds faster."),
    ] = None
    precision: Annotated[
        Literal["default", "float32", "int8", "auto"],
        arg(
            help="Numbers that the backbone computes with. default: what a recording was made with, else float32; "
            "int8: the bundle's variant of 8-bit numbers, where it has one; auto: that one where its report loses "
            "at most 0.01 AP50 and a short trial finds it faster on this processor.",
        ),
    ] = "default"
    engine: Annotated[
        Literal["default", "onnxruntime", "openvino", "openvino-bf16", "auto"],
        arg(
            help="What runs the backbone. default: what a recording was made with, else onnxruntime; openvino (extra "
            "openvino) computes with 32 bits as well, openvino-bf16 with 16 where the processor has them; auto: the "
            "one of these that a trial finds clearly fastest, remembered."
        ),
    ] = "default"

    def load(self, *specs: str, pace: "Pace" = "files", recorded: "Decisions | None" = None) -> "Bundle":
        """The bundle. specs: the sources of the run, which select the default one; standard error then names it with
        the reason. recorded: engine and precision of the run that made a recording, taken where none is asked for.
        """
        from edgemap.runtime.network.bundle import load_bundle

        at_least(1, threads=self.threads)
        if self.threads is not None and self.threads > MAXIMUM_THREADS:
            raise OptionError(f"--threads {self.threads}: at most {MAXIMUM_THREADS}")
        precision, engine = chosen_precision(self.precision, recorded), chosen_engine(self.engine, recorded)
        return load_bundle(bundle_of(self.bundle, *specs), self.threads, precision, pace=pace, engine=engine)


def bundle_of(name: str | None, *specs: str) -> Path:
    """Folder of a bundle by folder or name; a listed name that is not in the cache is pulled first. specs: as in
    `NetworkOptions.load`. Raises OptionError.
    """
    from edgemap.runtime.frames.reading import print_message
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
    return folder


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
