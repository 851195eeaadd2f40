"""The one base of every failure that edgemap knows and explains in one line."""


class EdgemapError(Exception):
    """A known failure: its text is one line that says what, where, and the numbers with their units.

    exit_code: with which the command line ends.
    """

    exit_code = 1


class GeometryError(EdgemapError):
    """A camera, mount or pose that cannot be: NaN or negative intrinsics, a mount looking at the sky."""


class MapError(EdgemapError):
    """A map file that cannot be read or written."""
