"""Many robots, one map: robots publish their maps over zenoh, and a keeper merges the latest map of each."""
