"""The live page: pictures and map of a run, served by the robot to any browser."""
