"""Names of the coordinate frames in messages."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class FrameIds:
    """Names of the frames. base: on the floor, at the turn axis; `base_footprint` on some robots (REP-120)."""

    map: str = "map"
    odom: str = "odom"
    base: str = "base_link"
    optical: str = "camera_optical_frame"


IDS = FrameIds()
