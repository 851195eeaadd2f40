"""Entry points of installed packages, our bridges among them: cameras, sinks, commands. Read once, when needed."""

from functools import cache
from importlib.metadata import EntryPoint, distributions
from typing import Any

from edgemap.geometry.errors import EdgemapError
from edgemap.runtime.frames.errors import PluginError
from edgemap.runtime.frames.reading import THEIRS, error_line, one_line

CAMERAS, SINKS = "edgemap.cameras", "edgemap.sinks"


def plugins(group: str) -> dict[str, EntryPoint]:
    """The entry points of a group, by name. Raises PluginError if two packages define the same name."""
    points: dict[str, EntryPoint] = {}
    for point in (point for point in declared() if point.group == group):
        other = points.setdefault(point.name, point)
        if other.value != point.value:
            raise PluginError(
                f"{group}: {point.name!r} comes from two packages, {package_of(other)} and {package_of(point)}: "
                "uninstall one"
            )
    return points


@cache
def declared() -> list[EntryPoint]:
    """Of all distributions: `entry_points` takes the first of a name, and a build leaves an old one in a checkout."""
    return [point for one in distributions() for point in one.entry_points if point.group.startswith("edgemap.")]


def load_plugin(point: EntryPoint) -> Any:
    """Imports what an entry point names. Raises PluginError, which names the package, if that fails."""
    try:
        return point.load()
    except EdgemapError:
        raise
    except THEIRS as error:
        raise PluginError(
            f"{point.group}: {point.name!r} of {package_of(point)} does not load ({one_line(error_line(error), 200)})"
        ) from error


def package_of(point: EntryPoint) -> str:
    """The name of the distribution that an entry point comes from."""
    return point.dist.name if point.dist else point.value
