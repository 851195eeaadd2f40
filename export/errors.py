"""The host side's expected failures; each message is one line with what, where, and the numbers."""

from edgemap.geometry.errors import EdgemapError


class ExportError(EdgemapError):
    """A network, weights file or checkpoint that cannot become a bundle."""
