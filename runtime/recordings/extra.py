"""The one place that says which part of the installation recordings need."""

from __future__ import annotations

from importlib.util import find_spec

from edgemap.runtime.errors import MissingExtraError


def need_mcap() -> None:
    """Raise MissingExtraError where mcap or its ROS 2 part cannot be imported."""
    if any(find_spec(name) is None for name in ("mcap", "mcap_ros2")):
        raise MissingExtraError("recordings need mcap and mcap-ros2-support: pip install 'edgemap[record]'")
