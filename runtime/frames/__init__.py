"""What a camera delivers and every room reads: frames, sensor samples, faults, errors, trajectories, files of rows."""
