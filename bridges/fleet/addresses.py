"""Addresses of the keeper of a place, for zenoh."""

from edgemap.bridges.fleet.network import PORT
from edgemap.runtime.frames.option_texts import host_and_port

LOCAL = "127.0.0.1"


def place_and_address(text: str, option: str) -> tuple[str, str]:
    """`PLACE`, and the address after its `@`. Raises UsageError."""
    place, at, host = text.partition("@")
    return place, zenoh_address(host if at else LOCAL, option)


def zenoh_address(text: str, option: str) -> str:
    """HOST:PORT as zenoh writes it. Raises UsageError."""
    host, number = host_and_port(text, option, PORT)
    return f"[{host}]:{number}" if ":" in host else f"{host}:{number}"
