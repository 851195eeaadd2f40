"""Recordings: one MCAP file with ROS 2 messages, as Foxglove and ROS 2 tools read it."""
