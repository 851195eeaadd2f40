"""Cameras, one file each, and what supervises them; `edgemap.runtime.inputs.open` makes one of a SPEC."""
