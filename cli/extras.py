"""Checks that the extras of a command are installed, before it starts."""

from edgemap.runtime.frames.extras import need


def need_export(command: str = "edgemap export") -> None:
    """Raise MissingExtraError where torch, onnx or onnxscript cannot be imported."""
    need("export", command, ("torch", "onnx", "onnxscript"))


def need_training(command: str) -> None:
    """Raises MissingExtraError where torch or onnx, which training needs, cannot be imported."""
    need("export", command, ("torch", "onnx"))


def need_simulation(command: str = "edgemap simulate") -> None:
    """Raise MissingExtraError where the renderer, the light baker or the picture reader cannot be imported."""
    need("simulation", command, ("moderngl", "embreex", "PIL"))
