"""Kinds of cameras by entry point (group `edgemap.cameras`): of other packages, our bridges, the simulation."""

from collections.abc import Sequence
from importlib.metadata import EntryPoint
from pathlib import Path
from typing import Protocol, cast

from edgemap.geometry.errors import EdgemapError
from edgemap.runtime.frames.camera import Camera, CameraOptions, Driver
from edgemap.runtime.frames.plugins import CAMERAS, load_plugin, plugins
from edgemap.runtime.frames.reading import user_path
from edgemap.runtime.frames.trajectory import Trajectory
from edgemap.runtime.inputs.drives.sensor_csv import read_wheel_csv


def read_wheels(spec: str) -> Trajectory:
    """The wheels' poses in `FILE.csv`, or in a file of a camera kind (`FILE.mcap[#/topic]`). Raises CameraError."""
    kind = file_kind(spec)
    return read_wheel_csv(Path(spec)) if kind is None else kind.wheels(spec)


class CameraKind(Protocol):
    """Interface of the object of an entry point `KIND = module:object`. A module with the functions is sufficient.

    `KIND` opens `--camera KIND[:ADDRESS]`; a name that begins with a dot, `.SUFFIX`, opens files that end so, and its
    address is the whole SPEC, `FILE.SUFFIX[#PART]`.
    """

    def open(self, address: str, how: CameraOptions) -> Driver | Camera:
        """Opens the camera. Raises CameraError, one line.

        A live source returns a Driver. The supervisor then reads its newest frame and reopens it after a failure. A
        finite source returns a Camera.
        """
        ...

    def found(self) -> Sequence[tuple[str, str]]:
        """(address, display name) of each connected camera, for `edgemap cameras`. A class that inherits it has none,
        for what is not searched for."""
        return ()


class FileKind(CameraKind, Protocol):
    """What kinds of files have too."""

    def wheels(self, address: str) -> Trajectory:
        """The wheels' poses in the file. Raises CameraError."""
        ...

    def recorded_from(self, address: str) -> str | None:
        """SPEC of the camera that the file was recorded from; None where it is unknown or the file is damaged."""
        ...


def kind_of(spec: str) -> tuple[EntryPoint, str] | None:
    """The entry point that opens a SPEC, and the address for it; None where no package does. Raises PluginError."""
    kinds = plugins(CAMERAS)
    kind, _, address = spec.partition(":")
    if kind in kinds:
        return kinds[kind], address
    file = spec.partition("#")[0]
    if _is_bag(user_path(file)):
        file = ".mcap"
    known = (point for name, point in kinds.items() if name[0] == "." and file.endswith(name) and kind != "realsense")
    return next(((point, spec) for point in known), None)


def _is_bag(folder: Path) -> bool:
    """Whether a folder is a bag of ROS 2."""
    return (folder / "metadata.yaml").is_file() and any(
        path.suffix in (".mcap", ".db3", ".zstd") for path in folder.iterdir()
    )


def file_kind(spec: str) -> FileKind | None:
    """The kind of a file, by its suffix. Raises PluginError."""
    kind = kind_of(spec)
    return cast(FileKind, load_plugin(kind[0])) if kind and kind[0].name.startswith(".") else None


def recorded_from(spec: str) -> str:
    """SPEC of the camera that a recording of ours was made with, through recordings of recordings; else as it is."""
    followed: set[str] = set()  # a file may name itself
    while spec not in followed:
        followed.add(spec)
        try:
            kind = file_kind(spec)
        except EdgemapError:  # opening the camera reports it
            break
        if kind is None:
            break
        spec = kind.recorded_from(spec) or ""
    return spec
