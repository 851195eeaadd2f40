"""Says which optional part of the installation a command lacks, before it starts."""

from __future__ import annotations

from importlib.util import find_spec

from edgemap.runtime.errors import MissingExtraError


def need_export(command: str = "edgemap export") -> None:
    """Raise MissingExtraError where torch, onnx or onnxscript cannot be imported."""
    if any(find_spec(name) is None for name in ("torch", "onnx", "onnxscript")):
        raise MissingExtraError(f"{command} needs torch and onnx: pip install 'edgemap[export]'")


def need_simulation(command: str = "edgemap simulate") -> None:
    """Raise MissingExtraError where the renderer, the light baker or the picture reader cannot be imported."""
    if any(find_spec(name) is None for name in ("moderngl", "embreex", "PIL")):
        raise MissingExtraError(f"{command} needs moderngl and embreex: pip install 'edgemap[simulation]'")
