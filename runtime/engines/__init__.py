"""Engines: what runs a bundle's networks. One file each; every one gives a `Network`."""
