"""Optional extras of the installation, and the command that installs a missing one."""

import json
import shutil
import sys
from importlib.metadata import PackageNotFoundError, distribution
from importlib.util import find_spec
from pathlib import Path
from urllib.parse import unquote, urlparse

from edgemap.runtime.frames.errors import MissingExtraError

DISTRIBUTION = "edgemap-robot"
OUTPUTS = {  # extra of each output of a run, with the modules that it takes
    "view": ("starlette", "uvicorn", "websockets"),
    "record": ("mcap", "mcap_ros2"),
    "foxglove": ("foxglove", "mcap_ros2"),
    "rerun": ("rerun",),
    "mqtt": ("paho",),
    "fleet": ("zenoh",),
    "ros2": ("cyclonedds", "mcap_ros2"),
}


def install_hint(extra: str) -> str:
    """The command that installs an extra: from this installation's source folder, else by the distribution's name."""
    try:
        origin = json.loads(distribution(DISTRIBUTION).read_text("direct_url.json") or "{}")
    except (PackageNotFoundError, ValueError):
        origin = {}
    address = urlparse(str(origin.get("url", "")))
    if address.scheme != "file":
        return f"{pip()} install '{DISTRIBUTION}[{extra}]'"
    editable = "-e " if origin.get("dir_info", {}).get("editable") else ""
    return f"{pip()} install {editable}'{unquote(address.path)}[{extra}]'"


def pip() -> str:
    """The command of this environment's pip: `pip` where it is on the PATH, else through the path of Python."""
    found, programs = shutil.which("pip"), Path(sys.executable).parent
    if found and Path(found).parent.resolve() == programs.resolve():
        return "pip"
    python = Path(sys.executable)
    if python.is_relative_to(Path.cwd()):
        python = python.relative_to(Path.cwd())
    return f"{python} -m pip"


def need_mcap() -> None:
    """Raise MissingExtraError where mcap or its ROS 2 part cannot be imported."""
    need("record", "a recording")


def need(extra: str, purpose: str, modules: tuple[str, ...] = ()) -> None:
    """Raise MissingExtraError where a module of an extra cannot be imported. purpose: what asks for it. modules: those
    of `OUTPUTS` where none are given."""
    missing = [name for name in modules or OUTPUTS[extra] if find_spec(name) is None]
    if missing:
        raise MissingExtraError(f"{purpose} needs {', '.join(missing)}: {install_hint(extra)}")
