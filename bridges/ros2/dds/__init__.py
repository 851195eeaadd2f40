"""ROS 2 over DDS without ROS: publishers and subscriptions that are compatible with ROS 2 nodes."""
