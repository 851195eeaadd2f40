"""Names, addresses and sessions of a fleet on zenoh."""

import json
import os
import re
from typing import Any

from edgemap.runtime.frames.errors import BridgeError
from edgemap.runtime.frames.extras import need
from edgemap.runtime.frames.option_texts import host_and_port

ROOT = "edgemap/fleet"
NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,63}", re.ASCII)


def checked_name(text: str, what: str) -> str:
    """The name of a robot or a place, which is part of a key and of a file name. Raises BridgeError."""
    if not NAME.fullmatch(text):
        raise BridgeError(f"{what} {text[:70]!r}: not 1 to 64 of A-Z a-z 0-9 _ . -, first a letter or digit")
    return text


def place_and_address(text: str, option: str) -> tuple[str, str]:
    """`PLACE`, and the address after its `@`, this machine's without one. Raises UsageError."""
    place, at, host = text.partition("@")
    return place, zenoh_address(host if at else "127.0.0.1", option)


def zenoh_address(text: str, option: str) -> str:
    """HOST:PORT as zenoh writes it. Raises UsageError."""
    host, number = host_and_port(text, option, 7447)  # zenoh's own
    return f"[{host}]:{number}" if ":" in host else f"{host}:{number}"


def open_session(connect: str = "", listen: str = "", wait_s: float | None = None) -> Any:
    """A zenoh session: a router that listens (`127.0.0.1:7447`), or a peer that connects to one and retries. wait_s:
    connect as a client, for this time at most. The file of ZENOH_CONFIG replaces all of this. Raises BridgeError, or
    MissingExtraError."""
    need("fleet", "--sink fleet")
    import zenoh

    file = os.environ.get("ZENOH_CONFIG")
    options = {
        "mode": "router" if listen else "peer" if wait_s is None else "client",
        "scouting/multicast/enabled": False,
        "listen/endpoints": [f"tcp/{listen}"] if listen else [],
        "connect/endpoints": [f"tcp/{connect}"] if connect else [],
        "connect/timeout_ms": -1 if wait_s is None else round(1e3 * wait_s),
        "connect/exit_on_failure": wait_s is not None,
        "transport/link/rx/max_message_size": 4 << 20,
    }
    try:
        config = zenoh.Config.from_file(file) if file else zenoh.Config()
        for key, value in ({} if file else options).items():
            config.insert_json5(key, json.dumps(value))
        return zenoh.open(config)
    except zenoh.ZError as error:
        where = file or (f"listening on {listen}" if listen else f"connecting to {connect}")
        raise BridgeError(f"fleet, {where}: {str(error).split(' at ')[0]}") from None
