"""Entry points of installed packages, our bridges among them: cameras, sinks, commands. Read once, when needed."""

from functools import cache
from importlib.metadata import EntryPoint, distributions
from typing import Any

from edgemap.geometry.errors import EdgemapError
from edgemap.runtime.frames.errors import PluginError
from edgemap.runtime.frames.reading import THEIRS, error_line, one_line, print_message

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
    if group in (CAMERAS, SINKS) and not any(point.value.startswith("edgemap.") for point in points.values()):
        _warn_of_old_metadata()
    return points


@cache
def declared() -> list[EntryPoint]:
    """Of all distributions: `entry_points` takes the first of a name, and a build leaves an old one in a checkout."""
    return [point for one in distributions() for point in one.entry_points if point.group.startswith("edgemap.")]


@cache
def _warn_of_old_metadata() -> None:
    """A checkout that was updated keeps the entry points of when it was installed; printed once."""
    print_message("edgemap's bridges are not registered: install it again (in a checkout: pip install -e .)")


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
