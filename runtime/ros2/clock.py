"""From a stream's stamps to ROS time, which is the wall clock's."""

NEAR_S = 5.0


def ros_offset_s(stamp_s: float, wall_s: float, monotonic_s: float) -> float:
    """Offset to add to a stream's stamps, from one frame that has just arrived.

    Cameras stamp by the wall clock or by the monotonic one; what is near neither (a file, a device's own clock)
    counts as taken now.
    """
    if abs(stamp_s - wall_s) < NEAR_S:
        return 0.0
    if abs(stamp_s - monotonic_s) < NEAR_S:
        return wall_s - monotonic_s
    return wall_s - stamp_s
