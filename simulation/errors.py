"""The simulation's expected failures, and the one way to ask for what only the extra brings."""

import importlib
from types import ModuleType

from edgemap.geometry.errors import EdgemapError
from edgemap.runtime.frames.errors import MissingExtraError
from edgemap.runtime.frames.extras import install_hint


class SimulationError(EdgemapError):
    """A world that cannot be built or drawn: missing furniture, no OpenGL, no room left."""


def require(module: str) -> ModuleType:
    """Import a module of the extra `edgemap-robot[simulation]`. Raises MissingExtraError naming the extra."""
    try:
        return importlib.import_module(module)
    except ImportError as error:
        raise MissingExtraError(
            f"the simulation needs {module.partition('.')[0]} ({error}): {install_hint('simulation')}"
        ) from None
