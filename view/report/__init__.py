"""The report of a run: the live page in one file, with the run's data embedded."""
