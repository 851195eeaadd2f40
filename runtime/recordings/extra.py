"""The one place that says which part of the installation recordings need."""

from edgemap.runtime.extras import need


def need_mcap() -> None:
    """Raise MissingExtraError where mcap or its ROS 2 part cannot be imported."""
    need("record", "a recording", ("mcap", "mcap_ros2"))
