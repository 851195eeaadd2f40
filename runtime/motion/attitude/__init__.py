"""The camera's tilt in each frame, by its sources."""
