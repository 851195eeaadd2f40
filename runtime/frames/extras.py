"""Optional extras of the installation, and the command that installs a missing one."""

import json
import shlex
import sys
from importlib.metadata import PackageNotFoundError, distribution
from importlib.util import find_spec
from urllib.parse import unquote, urlparse

from edgemap.runtime.frames.errors import MissingExtraError

DISTRIBUTION = "edgemap-robot"
# Extra to what it is for, and its modules with the packages that they come in.
EXTRAS: dict[str, tuple[str, dict[str, str]]] = {
    "realsense": ("RealSense cameras and their recordings", {"pyrealsense2": "pyrealsense2"}),
    "teacher": ("train floor --teacher", {"ai_edge_litert": "ai-edge-litert"}),
    "export": ("pull by name, export, train", {"torch": "torch", "onnx": "onnx", "onnxscript": "onnxscript"}),
    "plot": ("figures of detect, eval and bench --plot", {"matplotlib": "matplotlib"}),
    "evaluation": ("eval detection", {"faster_coco_eval": "faster-coco-eval"}),
    "simulation": ("rendered rooms", {"moderngl": "moderngl", "av": "av", "PIL": "pillow", "embreex": "embreex"}),
    "openvino": ("bench --against openvino", {"openvino": "openvino"}),
    "view": ("run --view", {"starlette": "starlette", "uvicorn": "uvicorn", "websockets": "websockets"}),
    "record": ("record, run --record, recordings as cameras", {"mcap": "mcap", "mcap_ros2": "mcap-ros2-support"}),
    "ros1": ("bags of ROS 1", {"rosbags": "rosbags"}),
    "foxglove": ("run --foxglove", {"foxglove": "foxglove-sdk", "mcap_ros2": "mcap-ros2-support"}),
    "mqtt": ("run --mqtt", {"paho": "paho-mqtt"}),
    "mcp": ("edgemap mcp", {"mcp": "mcp"}),
    "fleet": ("run --sink fleet, fleet serve", {"zenoh": "eclipse-zenoh"}),
    "ros2": (
        "run --ros2, cameras and sensors on ROS 2 topics",
        {"cyclonedds": "cyclonedds", "mcap_ros2": "mcap-ros2-support"},
    ),
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
    """The command of this environment's pip, whether or not the environment is active."""
    return f"{shlex.quote(sys.executable)} -m pip"


def need(extra: str, purpose: str, modules: tuple[str, ...] = ()) -> None:
    """Raise MissingExtraError where a module of an extra cannot be imported. purpose: what asks for it. modules: those
    that it needs; all of the extra by default."""
    missing = [name for name in modules or EXTRAS[extra][1] if find_spec(name) is None]
    if missing:
        raise MissingExtraError(f"{purpose} needs {', '.join(missing)}: {install_hint(extra)}")
