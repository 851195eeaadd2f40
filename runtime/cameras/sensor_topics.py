"""Which ROS 2 topics bring further sensors of the robot."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class SensorTopics:
    """ROS 2 topics beside a camera: of the recording where that is one, else live. wheels: nav_msgs/Odometry. imu:
    sensor_msgs/Imu. depth: of the pictures' pixels, sensor_msgs/Image, or CompressedImage as compressedDepth. optical:
    the camera's frame in tf, where its messages do not name it."""

    wheels: str | None = None
    imu: str | None = None
    depth: str | None = None
    optical: str = "camera_optical_frame"
