from importlib.util import find_spec

from edgemap.runtime.errors import MissingExtraError

if find_spec("matplotlib") is None:
    raise MissingExtraError("drawing needs matplotlib: pip install 'edgemap[plot]'")
