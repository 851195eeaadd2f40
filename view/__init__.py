"""The live page: what a run sees and maps, served by the robot to any browser."""
