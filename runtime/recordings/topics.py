"""Names of the topics that edgemap records."""

PICTURES, INFO, STAMPS = "/camera/image/compressed", "/camera/camera_info", "/camera/stamp_s"
WHEEL, TRUTH, TF = "/wheel/odometry", "/ground_truth/odometry", "/tf"
ODOMETRY, BOXES, OBJECTS, MARKERS = "/odometry", "/detections", "/map/objects", "/map/markers"
