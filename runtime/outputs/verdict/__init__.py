"""The verdict on a map, from a run's statistics, and the causes that explain a poor one."""
