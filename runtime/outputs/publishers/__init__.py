"""Live outputs to other programs: sinks that publish the messages of `outputs.messages` in every step."""
