"""ROS 2 message definitions, topics and stamps, for those that read and those that write."""
