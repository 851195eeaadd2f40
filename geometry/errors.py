"""Base class of all expected errors of edgemap."""


class EdgemapError(Exception):
    """An expected error. Its text is one line: what failed, where, and the numbers with their units.

    exit_code: with which the command line ends.
    """

    exit_code = 1

    def __str__(self) -> str:
        return " ".join(super().__str__().splitlines())


class GeometryError(EdgemapError):
    """A camera, mount or pose that cannot be: NaN or negative intrinsics, a mount looking at the sky."""


class MapError(EdgemapError):
    """A map file that cannot be read or written."""
