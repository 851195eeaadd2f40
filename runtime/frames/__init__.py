"""Data types shared by all rooms: frames, sensor samples, faults, errors, trajectories, tables."""
