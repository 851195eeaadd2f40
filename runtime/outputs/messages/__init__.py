"""ROS 2 messages of what a run finds: built, named and encoded in one place for recordings and live outputs."""
