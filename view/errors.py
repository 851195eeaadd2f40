"""The live page's known failures."""

from edgemap.geometry.errors import EdgemapError


class ViewError(EdgemapError):
    """An address that the live page cannot be served on."""
