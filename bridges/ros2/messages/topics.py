"""Names, types and coordinate frames of the topics that edgemap writes, for recordings and live outputs alike."""

from dataclasses import dataclass

PICTURES, INFO, STAMPS = "/camera/image/compressed", "/camera/camera_info", "/camera/stamp_s"
SEARCHED = "/camera/searched"  # 0 with a picture that a budget did not have searched
WHEEL, TRUTH, TF, TF_STATIC = "/wheel/odometry", "/ground_truth/odometry", "/tf", "/tf_static"
IMU = "/imu"
DEPTH = "/camera/depth/compressed"  # of the picture's pixels, at its stamp
EDITS = "/edits"  # lines of edits.jsonl
POSE, ODOMETRY, BOXES = "/pose", "/odometry", "/detections"
OBJECTS, MARKERS, GRID = "/map/objects", "/map/markers", "/map/grid"
GOAL = "/goal_pose"  # which Nav2's bt_navigator drives to
DIAGNOSTICS, LABELS = "/diagnostics", "/labels"  # for robot monitors; the detector's classes
MAP, FLOOR_SCAN = "/map", "/floor_scan"  # the mapped floor, and where this picture's floor ends

KINDS = {
    PICTURES: "sensor_msgs/msg/CompressedImage",
    INFO: "sensor_msgs/msg/CameraInfo",
    STAMPS: "std_msgs/msg/Float64",
    SEARCHED: "std_msgs/msg/Float64",
    WHEEL: "nav_msgs/msg/Odometry",
    TRUTH: "nav_msgs/msg/Odometry",
    TF: "tf2_msgs/msg/TFMessage",
    TF_STATIC: "tf2_msgs/msg/TFMessage",
    IMU: "sensor_msgs/msg/Imu",
    DEPTH: "sensor_msgs/msg/CompressedImage",
    EDITS: "std_msgs/msg/String",
    POSE: "geometry_msgs/msg/PoseWithCovarianceStamped",
    ODOMETRY: "nav_msgs/msg/Odometry",
    BOXES: "vision_msgs/msg/Detection2DArray",
    OBJECTS: "vision_msgs/msg/Detection3DArray",
    MARKERS: "visualization_msgs/msg/MarkerArray",
    GRID: "nav_msgs/msg/OccupancyGrid",
    GOAL: "geometry_msgs/msg/PoseStamped",
    MAP: "nav_msgs/msg/OccupancyGrid",
    FLOOR_SCAN: "sensor_msgs/msg/LaserScan",
    DIAGNOSTICS: "diagnostic_msgs/msg/DiagnosticArray",
    LABELS: "vision_msgs/msg/LabelInfo",
}


@dataclass(frozen=True, slots=True)
class FrameIds:
    """Names of the frames. base: on the floor, at the turn axis; `base_footprint` on some robots (REP-120)."""

    map: str = "map"
    odom: str = "odom"
    base: str = "base_link"
    optical: str = "camera_optical_frame"


IDS = FrameIds()
