"""Recording a run as MCAP."""
