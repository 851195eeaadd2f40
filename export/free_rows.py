"""Backbones whose input may have fewer rows: a picture that does not fill it costs no more than its own."""

import copy

import onnx
import onnxruntime as ort
from onnx import ModelProto

from edgemap.runtime.network.engines import PROVIDERS, ROWS, session_options
from edgemap.runtime.network.manifest import DetectorSpec
from edgemap.runtime.network.network import Compute


def free_rows(model: ModelProto, detector: DetectorSpec) -> ModelProto:
    """The model with its rows left open, where pictures are letterboxed and all outputs are maps.

    The same model where they are not, or where something in it is of a fixed size (YOLOX's list of boxes).
    """
    height = detector.input.height
    shapes = detector.outputs()
    if detector.input.resize == "stretch" or any(len(shape) != 4 for shape in shapes.values()):
        return model
    freed = copy.deepcopy(model)
    del freed.graph.value_info[:]
    for value in (freed.graph.input[0], *freed.graph.output):
        rows = value.type.tensor_type.shape.dim[2]
        part = height // rows.dim_value
        rows.Clear()
        rows.dim_param = ROWS if part == 1 else f"{ROWS}/{part}"
    coarsest = max(height // shape[2] for shape in shapes.values())
    return freed if _fits(freed, height, shapes) and _fits(freed, height - coarsest, shapes, height) else model


def _fits(model: ModelProto, rows: int, shapes: dict[str, tuple[int, ...]], height: int | None = None) -> bool:
    """Whether the outputs have the shapes that so many input rows ask for. shapes: of `height` rows."""
    options = session_options(Compute(), rows)
    try:
        onnx.checker.check_model(model, full_check=True)
        session = ort.InferenceSession(model.SerializeToString(), options, providers=PROVIDERS)
    except Exception:  # onnxruntime's exceptions share no public base
        return False
    found = {node.name: tuple(node.shape) for node in session.get_outputs()}
    wanted = {n: (*shape[:2], shape[2] * rows // (height or rows), shape[3]) for n, shape in shapes.items()}
    return found == wanted
