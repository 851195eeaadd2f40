"""Cameras of other packages: entry points of the group `edgemap.cameras`, one kind of SPEC each."""

from collections.abc import Sequence
from importlib.metadata import EntryPoint, entry_points
from typing import Protocol

from edgemap.geometry.camera.intrinsics import Intrinsics
from edgemap.geometry.camera.mount import Mount
from edgemap.geometry.errors import EdgemapError
from edgemap.runtime.frames.errors import CameraError
from edgemap.runtime.frames.reading import one_line
from edgemap.runtime.inputs.cameras.protocol import Camera, Driver

GROUP = "edgemap.cameras"


class CameraKind(Protocol):
    """Interface of an entry point `KIND = module:object`: a module with these two functions suffices."""

    def open(self, address: str, intrinsics: Intrinsics | None, mount: Mount | None) -> Driver | Camera:
        """Open SPEC `KIND:ADDRESS` (`KIND` alone: an empty address). Raises CameraError, one line.

        A live source returns a Driver, which is then supervised, recovered and read for its newest frame; a finite
        source returns a Camera. intrinsics, mount: given by the user; they override the source's own.
        """
        ...

    def found(self) -> Sequence[tuple[str, str]]:
        """(address, display name) of each connected camera, for `edgemap cameras`."""
        ...


def plugin_kinds() -> dict[str, EntryPoint]:
    """Kinds of other packages, by name. Raises CameraError where two packages bring the same one."""
    kinds: dict[str, EntryPoint] = {}
    for point in entry_points(group=GROUP):
        other = kinds.setdefault(point.name, point)
        if other.value != point.value:
            raise CameraError(
                f"camera kind {point.name!r} comes from two packages, {_package(other)} and {_package(point)}: "
                "uninstall one"
            )
    return kinds


def load_kind(point: EntryPoint) -> CameraKind:
    """Loads an entry point. Raises CameraError, naming the package, where the import fails."""
    try:
        return point.load()
    except EdgemapError:
        raise
    except Exception as error:  # another package's import may raise anything
        raise CameraError(
            f"camera kind {point.name!r} of {_package(point)} does not load ({type(error).__name__}: "
            f"{one_line(str(error), 200)})"
        ) from error


def _package(point: EntryPoint) -> str:
    return point.dist.name if point.dist else point.value
