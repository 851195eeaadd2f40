"""Errors of the command line itself."""

from edgemap.geometry.errors import EdgemapError


class OptionError(EdgemapError):
    """An option's value that cannot be used: wrong usage, which no repetition mends."""

    exit_code = 2
