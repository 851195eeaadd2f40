"""The simulation's expected failures."""

from edgemap.geometry.errors import EdgemapError


class SimulationError(EdgemapError):
    """A world that cannot be built or drawn: missing furniture, no OpenGL, no room left."""
