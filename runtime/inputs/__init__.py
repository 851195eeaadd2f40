"""Where frames come from: cameras, drives, recordings, ROS 2, and what reopens them."""
