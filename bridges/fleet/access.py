"""Who may join a fleet: a shared secret, or a password for each robot, which may then send under its own name alone.

zenoh itself checks: passwords by challenge and response at every connection, keys by its access control.
"""

import os
import re
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from edgemap.runtime.frames.errors import PublishError
from edgemap.runtime.frames.reading import one_line, read_text

SECRET = "EDGEMAP_FLEET_SECRET"  # of the environment: `SECRET` of all, or `NAME:PASSWORD` of one robot
NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,63}", re.ASCII)
ANYBODY = "edgemap"  # user of the shared secret; where each robot has a password, it may ask and not send
MAXIMUM_ROBOTS = 100  # of a place; of one robot's map see `network.MAXIMUM_OBJECTS`
_PASSWORD = re.compile(r"[\x21-\x39\x3b-\x7e]{8,200}")
_FORM = "8 to 200 printable ASCII characters without spaces and colons"


def secret_of_environment() -> tuple[str, str]:
    """User and password of `EDGEMAP_FLEET_SECRET`; both empty where it is not set, or ZENOH_CONFIG takes its place.
    Raises PublishError."""
    text = "" if os.environ.get("ZENOH_CONFIG") else os.environ.get(SECRET, "")
    user, colon, password = text.rpartition(":")
    if text and (not _PASSWORD.fullmatch(password) or (colon and not NAME.fullmatch(user))):
        raise PublishError(f"{SECRET} must be {_FORM}, or a robot's NAME:PASSWORD")
    return (user or ANYBODY, password) if text else ("", "")


def access_is_limited() -> bool:
    """Whether the environment limits who may join: by a secret, or by zenoh's own settings."""
    return bool(os.environ.get(SECRET) or os.environ.get("ZENOH_CONFIG"))


def robot_of_environment() -> str | None:
    """The robot whose password `EDGEMAP_FLEET_SECRET` is; None where it is a shared secret. Raises PublishError."""
    user, _ = secret_of_environment()
    return user if user not in ("", ANYBODY) else None


def read_passwords(path: Path) -> dict[str, str]:
    """Passwords by robot, of a file with a line NAME:PASSWORD each; lines of `#` are comments. Raises PublishError."""
    passwords: dict[str, str] = {}
    for number, line in enumerate(read_text(path, 1 << 16, PublishError).splitlines(), start=1):
        if not line.strip() or line.startswith("#"):
            continue
        name, _, password = line.strip().partition(":")
        if not NAME.fullmatch(name) or name == ANYBODY or not _PASSWORD.fullmatch(password):
            raise PublishError(f"{path}, line {number}: not a robot's NAME:PASSWORD (password: {_FORM})")
        if name in passwords:
            raise PublishError(f"{path}, line {number}: {one_line(name)} has a password already")
        passwords[name] = password
    if not 1 <= len(passwords) <= MAXIMUM_ROBOTS:
        raise PublishError(f"{path}: {len(passwords)} robots; a place has 1 to {MAXIMUM_ROBOTS}")
    return passwords


@contextmanager
def password_settings(robots: Mapping[str, str]) -> Iterator[dict[str, Any]]:
    """zenoh's settings of the own password and of those that are let in; valid while its file exists. robots: their
    passwords by name, for a keeper that gives each its own. Raises PublishError."""
    user, password = secret_of_environment()
    if robots and user in robots:
        raise PublishError(f"{SECRET} is that of the robot {user}; a keeper has the one that only asks, or none")
    own = {"user": user, "password": password} if user else {}
    everybody = {**robots, user: password} if user else robots
    if not everybody:
        yield {}
        return
    with tempfile.TemporaryDirectory(prefix="edgemap-") as folder:  # only this user may enter it
        path = Path(folder) / "passwords"
        path.write_text("".join(f"{name}:{word}\n" for name, word in everybody.items()))
        yield {f"transport/auth/usrpwd/{key}": value for key, value in (own | {"dictionary_file": str(path)}).items()}


def own_names_only(robots: Mapping[str, str], root: str) -> dict[str, Any]:
    """zenoh's access control: each robot sends below `root/robots/NAME` of its own name, and everybody who is let in
    may ask for the map.
    """
    below = [f"{root}/**"]
    asking = ["declare_subscriber", "query", "declare_liveliness_subscriber", "liveliness_query"]
    hearing = ["declare_subscriber", "declare_queryable", "reply", "put", "liveliness_token"]
    rules = [_rule("ask", "ingress", asking, below), _rule("hear", "egress", hearing, below)]
    policies = [{"subjects": [ANYBODY], "rules": ["ask", "hear"]}]
    for name in robots:
        own = [f"{root}/robots/{name}{part}" for part in ("", "/map", "/pose")]
        rules.append(_rule(f"send {name}", "ingress", ["put", "liveliness_token"], own))
        policies.append({"subjects": [name], "rules": ["ask", "hear", f"send {name}"]})
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": rules,
        "subjects": [{"id": name, "usernames": [name]} for name in (ANYBODY, *robots)],
        "policies": policies,
    }


def _rule(identity: str, flow: str, messages: list[str], keys: list[str]) -> dict[str, Any]:
    return {"id": identity, "permission": "allow", "flows": [flow], "messages": messages, "key_exprs": keys}
