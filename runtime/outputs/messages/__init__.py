"""ROS 2 messages of a run's results: built, named and encoded in one place for recordings and live outputs."""
