"""How far a map can be trusted, and why: a verdict of what a run counted, and the causes that explain a poor one."""
