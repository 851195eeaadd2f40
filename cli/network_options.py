"""The network of a command and what runs it. No heavy imports here."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from edgemap.cli.arguments import arg
from edgemap.cli.options import BundleName, at_least
from edgemap.runtime.frames.errors import BundleError, UsageError
from edgemap.runtime.frames.option_texts import known_names
from edgemap.runtime.frames.reading import print_message

if TYPE_CHECKING:
    from edgemap.runtime.frames.inference import Inference
    from edgemap.runtime.network.bundle import Bundle
    from edgemap.runtime.network.engines import Pace

MAXIMUM_THREADS = 64


@dataclass(frozen=True)
class NetworkOptions:
    """The network and what runs it."""

    bundle: BundleName = None
    names: Annotated[
        Path | None,
        arg(
            metavar="FILE",
            help="Class names of a detector's FILE.onnx that states none and has not COCO's: its data.yaml, or a text "
            "file with one a line.",
        ),
    ] = None
    threads: Annotated[
        int | None,
        arg(
            metavar="N",
            help="Threads of the backbone; by default one at a camera's pace and two where files are read as fast as "
            "possible. They change no result.",
        ),
    ] = None
    precision: Annotated[
        Literal["float32", "int8"] | None,
        arg(
            metavar="float32|int8",
            help="Numbers that the backbone computes with; by default float32, or what a recording was made with. "
            "int8: the bundle's variant of 8-bit numbers, where it has one.",
        ),
    ] = None
    engine: Annotated[
        Literal["onnxruntime", "openvino"] | None,
        arg(
            metavar="onnxruntime|openvino",
            help="What runs the backbone; by default onnxruntime, or what a recording was made with. openvino: extra "
            "openvino, float32 as well.",
        ),
    ] = None

    def load(
        self, *specs: str, pace: "Pace" = "files", recorded: "Inference | None" = None, alone: bool = False
    ) -> "Bundle":
        """The bundle. specs: the sources of the run, which select the default one; standard error then names it with
        the reason. recorded: engine and precision of the run that made a recording, used where none is asked for.
        alone: without a companion, for boxes in pictures.
        """
        from edgemap.runtime.frames.class_names import read_class_names
        from edgemap.runtime.inputs.cameras.kinds import recorded_from
        from edgemap.runtime.network.open_bundle import open_bundle
        from edgemap.runtime.network.store import default_bundle

        at_least(1, threads=self.threads)
        if self.threads is not None and self.threads > MAXIMUM_THREADS:
            raise UsageError(f"--threads {self.threads}: at most {MAXIMUM_THREADS}")
        chosen = self.inference(recorded)
        companion = None if alone else default_bundle(*map(recorded_from, specs))[0]
        names = self.names and read_class_names(self.names, BundleError)
        return open_bundle(
            bundle_of(self.bundle, *specs), companion, self.threads, chosen.precision, pace, chosen.engine, names
        )

    def inference(self, recorded: "Inference | None" = None) -> "Inference":
        """Engine and precision asked for, else the recorded ones, else the defaults. A recorded engine that is not
        installed is replaced by onnxruntime, with a message."""
        from importlib.util import find_spec

        from edgemap.runtime.frames.inference import Inference

        engine, precision = (recorded.engine, recorded.precision) if recorded else ("onnxruntime", "float32")
        if engine == "openvino" and self.engine is None and find_spec("openvino") is None:
            print_message("recorded with openvino, which is not installed: the map may differ slightly")
            engine = "onnxruntime"
        return Inference(self.engine or engine, self.precision or precision)


def bundle_of(name: str | None, *specs: str) -> Path:
    """Folder of a bundle by folder or name; a listed name that is not in the cache is pulled first. specs: as in
    `NetworkOptions.load`. Raises UsageError.
    """
    from edgemap.runtime.inputs.cameras.kinds import recorded_from
    from edgemap.runtime.network.store import bundle_folder, default_bundle, shipped_bundles

    if name is None:
        name, reason = default_bundle(*map(recorded_from, specs))
        print_message(f"bundle {name}: {reason}")
    folder = bundle_folder(name)
    if folder.suffix == ".onnx" and folder.is_file():
        return folder
    if folder.is_file():
        raise UsageError(f"--bundle {name}: expected a bundle's folder, its name, or a detector's FILE.onnx")
    if not (folder / "bundle.json").is_file() and not Path(name).exists():
        from edgemap.cli.pull import KNOWN, pull_known

        if name not in KNOWN:
            shipped = shipped_bundles()
            hint = known_names([name], [*shipped, *KNOWN], "")
            hint = hint if hint.startswith("did") else "no such bundle."
            raise UsageError(
                f"--bundle {name}: {hint} The package has {', '.join(shipped)}; edgemap pull fetches "
                f"{', '.join(sorted(set(KNOWN) - set(shipped)))}; or give a bundle's folder"
            )
        folder = pull_known(name)
    return folder
