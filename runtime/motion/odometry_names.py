"""Names of odometries by what their lengths depend on. No imports: the command line's help reads them."""

HYBRID = "hybrid"  # lengths are in proportion to the height of the lens


def is_pose_file(spec: str) -> bool:
    """Whether an odometry is poses in a file: FILE.tum, or FILE.txt as ORB-SLAM3 names them."""
    return spec.endswith((".tum", ".txt")) and not spec.startswith("wheel:")


def is_tf(spec: str) -> bool:
    """Whether an odometry is poses by tf: tf, or tf:MAP,BASE."""
    return spec.partition(":")[0] == "tf"
