"""Live outputs to other programs: sinks that publish what `runtime.messages` makes of every step."""
