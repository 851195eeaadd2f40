"""Names, types and coordinate frames of the topics that edgemap writes, for recordings and live outputs alike."""

from dataclasses import dataclass


class Topic(str):
    """A topic's name. kind: its ROS 2 type."""

    kind: str

    def __new__(cls, name: str, kind: str) -> "Topic":
        """As of the class."""
        topic = super().__new__(cls, name)
        topic.kind = kind
        return topic


PICTURES = Topic("/camera/image/compressed", "sensor_msgs/msg/CompressedImage")
INFO = Topic("/camera/camera_info", "sensor_msgs/msg/CameraInfo")
STAMPS = Topic("/camera/stamp_s", "std_msgs/msg/Float64")
SEARCHED = Topic("/camera/searched", "std_msgs/msg/Float64")  # 0 with a picture that a budget did not have searched
DEPTH = Topic("/camera/depth/compressed", "sensor_msgs/msg/CompressedImage")  # of the picture's pixels, at its stamp
WHEEL = Topic("/wheel/odometry", "nav_msgs/msg/Odometry")
TRUTH = Topic("/ground_truth/odometry", "nav_msgs/msg/Odometry")
TF, TF_STATIC = Topic("/tf", "tf2_msgs/msg/TFMessage"), Topic("/tf_static", "tf2_msgs/msg/TFMessage")
IMU = Topic("/imu", "sensor_msgs/msg/Imu")
EDITS = Topic("/edits", "std_msgs/msg/String")  # lines of edits.jsonl
POSE = Topic("/pose", "geometry_msgs/msg/PoseWithCovarianceStamped")
ODOMETRY = Topic("/odometry", "nav_msgs/msg/Odometry")
BOXES = Topic("/detections", "vision_msgs/msg/Detection2DArray")
OBJECTS = Topic("/map/objects", "vision_msgs/msg/Detection3DArray")
MARKERS = Topic("/map/markers", "visualization_msgs/msg/MarkerArray")
GRID = Topic("/map/grid", "nav_msgs/msg/OccupancyGrid")
MAP = Topic("/map", "nav_msgs/msg/OccupancyGrid")  # the mapped floor
FLOOR_SCAN = Topic("/floor_scan", "sensor_msgs/msg/LaserScan")  # where this picture's floor ends
GOAL = Topic("/goal_pose", "geometry_msgs/msg/PoseStamped")  # which Nav2's bt_navigator drives to
DIAGNOSTICS = Topic("/diagnostics", "diagnostic_msgs/msg/DiagnosticArray")  # for robot monitors
LABELS = Topic("/labels", "vision_msgs/msg/LabelInfo")  # the detector's classes


@dataclass(frozen=True, slots=True)
class FrameIds:
    """Names of the frames. base: on the floor, at the turn axis; `base_footprint` on some robots (REP-120)."""

    map: str = "map"
    odom: str = "odom"
    base: str = "base_link"
    optical: str = "camera_optical_frame"


IDS = FrameIds()
