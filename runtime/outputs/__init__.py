"""Where results go: run folder, report, recording, messages, publishers, map files, fleet."""
