"""What must hold on a robot that runs for weeks: camera faults, kills, hostile files, a long day."""
