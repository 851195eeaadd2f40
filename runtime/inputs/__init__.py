"""Sources of frames: cameras, drives, recordings, ROS 2, and their recovery."""
