"""A camera's lens and mount from pictures."""
