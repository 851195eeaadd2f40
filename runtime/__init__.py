"""From frames to a map on the robot."""
