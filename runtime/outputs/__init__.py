"""Outputs: run folder, report, recording, messages, publishers, map files, fleet."""
