"""YOLOX-Nano of the package with the outputs of other families: the same boxes in every layout that exports have."""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

from edgemap.runtime.frames.class_names import COCO_91, COCO_NAMES
from edgemap.runtime.network.store import bundle_folder

SIDE, CELLS, BEST = 416, 3549, 100
CATEGORY = np.array([COCO_91.index(name) for name in COCO_NAMES], dtype=np.int64)


class Graph:
    """The backbone, with nodes appended to its raw output."""

    def __init__(self) -> None:
        self.model = onnx.load(bundle_folder("yolox-nano") / "backbone.onnx")
        self.graph = self.model.graph
        del self.graph.output[:], self.model.metadata_props[:]
        self._count = 0

    def node(self, kind: str, *inputs: "str | np.ndarray", **attributes: Any) -> str:
        """Append a node; its output. Arrays become constants."""
        self._count += 1
        names = [one if isinstance(one, str) else self.constant(one) for one in inputs]
        made = f"added_{self._count}"
        self.graph.node.append(helper.make_node(kind, names, [made], **attributes))
        return made

    def constant(self, value: np.ndarray) -> str:
        self._count += 1
        name = f"constant_{self._count}"
        self.graph.initializer.append(numpy_helper.from_array(value, name))
        return name

    def cut(self, name: str, first: int, last: int, axis: int = 2) -> str:
        return self.node("Slice", name, *(np.array([one], np.int64) for one in (first, last, axis)))

    def boxes(self) -> str:
        """Centres and sides (1, N, 4) in px of the input."""
        strides = np.concatenate([np.full((SIDE // s) ** 2, s, np.float32) for s in (8, 16, 32)])[None, :, None]
        grids = (np.meshgrid(np.arange(SIDE // s), np.arange(SIDE // s)) for s in (8, 16, 32))
        cells = [np.stack(grid, -1).reshape(-1, 2) for grid in grids]
        centres = self.node("Add", self.cut("output", 0, 2), np.concatenate(cells).astype(np.float32)[None])
        sides = self.node("Exp", self.cut("output", 2, 4))
        return self.node("Mul", self.node("Concat", centres, sides, axis=2), strides)

    def corners(self) -> str:
        boxes = self.boxes()
        centres = self.cut(boxes, 0, 2)
        half = self.node("Mul", self.cut(boxes, 2, 4), np.array([0.5], np.float32))
        return self.node("Concat", self.node("Sub", centres, half), self.node("Add", centres, half), axis=2)

    def scores(self) -> str:
        """Scores (1, N, 80)."""
        return self.node("Mul", self.cut("output", 4, 5), self.cut("output", 5, 85))

    def best(self) -> tuple[str, str, str]:
        """Corners (1, K, 4), scores (1, K) and labels (1, K) int64 of the best boxes."""
        scores = self.scores()
        highest = self.node("ReduceMax", scores, axes=[2], keepdims=0)
        labels = self.node("ArgMax", scores, axis=2, keepdims=0)
        self._count += 1
        values, rows = f"best_{self._count}", f"rows_{self._count}"
        best = self.constant(np.array([BEST], np.int64))
        self.graph.node.append(helper.make_node("TopK", [highest, best], [values, rows], axis=1))
        flat = self.node("Reshape", rows, np.array([BEST], np.int64))
        return self.node("Gather", self.corners(), flat, axis=1), values, self.node("Gather", labels, flat, axis=1)

    def column(self, name: str) -> str:
        """(1, K) as (1, K, 1)."""
        return self.node("Reshape", name, np.array([1, BEST, 1], np.int64))

    def flat(self, name: str, columns: int | None = None) -> str:
        """Without the batch."""
        return self.node("Reshape", name, np.array([BEST] if columns is None else [BEST, columns], np.int64))

    def give(self, **outputs: str) -> onnx.ModelProto:
        """The model with these outputs, under their names. Shapes are left open."""
        for name, made in outputs.items():
            self.graph.node.append(helper.make_node("Identity", [made], [name]))
        inferred = onnx.shape_inference.infer_shapes(self.model)
        types = {one.name: one.type.tensor_type.elem_type for one in inferred.graph.value_info}
        for name in outputs:
            self.graph.output.append(helper.make_tensor_value_info(name, types.get(name, TensorProto.FLOAT), None))
        return self.model

    def shares(self, name: str) -> str:
        return self.node("Div", name, np.array([SIDE], np.float32))


def class_columns(graph: Graph, share: bool = False) -> onnx.ModelProto:
    """YOLOv8 to YOLO12: (1, 84, N)."""
    boxes = graph.shares(graph.boxes()) if share else graph.boxes()
    table = graph.node("Concat", boxes, graph.scores(), axis=2)
    return graph.give(output0=graph.node("Transpose", table, perm=[0, 2, 1]))


def segmentation(graph: Graph) -> onnx.ModelProto:
    """A segmentation file: 32 coefficients behind the classes, and the masks' prototypes."""
    masks = np.random.default_rng(0).normal(size=(1, CELLS, 32)).astype(np.float32)
    table = graph.node("Concat", graph.boxes(), graph.scores(), masks, axis=2)
    prototypes = graph.node("Identity", np.zeros((1, 32, 104, 104), np.float32))
    return graph.give(output0=graph.node("Transpose", table, perm=[0, 2, 1]), output1=prototypes)


def objectness_rows(graph: Graph) -> onnx.ModelProto:
    """YOLOv5, and YOLOX decoded in its graph: (1, N, 85)."""
    return graph.give(boxes_out=graph.node("Concat", graph.boxes(), graph.cut("output", 4, 85), axis=2))


def cells(graph: Graph) -> onnx.ModelProto:
    """YOLOX as it comes: offsets and logarithms of cells."""
    return graph.give(raw=graph.node("Identity", "output"))


def class_rows(graph: Graph) -> onnx.ModelProto:
    """RT-DETR by Ultralytics: (1, N, 84), shares."""
    return graph.give(output0=graph.node("Concat", graph.shares(graph.boxes()), graph.scores(), axis=2))


def end_to_end(graph: Graph) -> onnx.ModelProto:
    """YOLOv10 and YOLO26: (1, K, 6)."""
    boxes, scores, labels = graph.best()
    last = [graph.column(one) for one in (scores, graph.node("Cast", labels, to=1))]
    return graph.give(output0=graph.node("Concat", boxes, *last, axis=2))


def logits(name: str, graph: Graph) -> str:
    clipped = graph.node("Clip", name, np.array(1e-6, np.float32), np.array(1.0 - 1e-6, np.float32))
    return graph.node("Log", graph.node("Div", clipped, graph.node("Sub", np.array([1.0], np.float32), clipped)))


def queries(graph: Graph) -> onnx.ModelProto:
    """RT-DETR and D-FINE of transformers: logits (1, Q, 80) and boxes (1, Q, 4)."""
    return graph.give(logits=logits(graph.scores(), graph), pred_boxes=graph.shares(graph.boxes()))


def categories(graph: Graph) -> onnx.ModelProto:
    """RF-DETR: boxes, and logits (1, Q, 91) by COCO's categories."""
    place = np.zeros((80, 91), np.float32)
    place[np.arange(80), CATEGORY] = 1.0
    labels = logits(graph.node("MatMul", graph.scores(), place), graph)
    return graph.give(dets=graph.shares(graph.boxes()), labels=labels)


def sized_lists(graph: Graph) -> onnx.ModelProto:
    """RT-DETR, D-FINE and DEIM with their postprocessor: labels, boxes, scores, in the size that is asked for."""
    graph.graph.input.append(helper.make_tensor_value_info("orig_target_sizes", TensorProto.INT64, ["N", 2]))
    boxes, scores, labels = graph.best()
    sizes = graph.node("Cast", "orig_target_sizes", to=1)
    scaled = graph.node("Mul", graph.shares(boxes), graph.node("Concat", sizes, sizes, axis=1))
    return graph.give(labels=labels, boxes=scaled, scores=scores)


def counted_lists(graph: Graph) -> onnx.ModelProto:
    """TensorRT's NMS: num_dets, det_boxes, det_scores, det_classes."""
    boxes, scores, labels = graph.best()
    return graph.give(
        num_dets=graph.node("Identity", np.array([[50]], np.int32)), det_boxes=boxes, det_scores=scores,
        det_classes=graph.node("Cast", labels, to=TensorProto.INT32),
    )  # fmt: skip


def tensorflow(graph: Graph) -> onnx.ModelProto:
    """TensorFlow's detection API: uint8, channels last; y before x; classes by category, as numbers with a point."""
    (picture,) = graph.graph.input
    for node in graph.graph.node:
        node.input[:] = ["planes" if name == picture.name else name for name in node.input]
    graph.graph.input[0].CopyFrom(helper.make_tensor_value_info("input_tensor", TensorProto.UINT8, [1, SIDE, SIDE, 3]))
    first = [
        helper.make_node("Cast", ["input_tensor"], ["floats"], to=1),
        helper.make_node("Transpose", ["floats"], ["rgb"], perm=[0, 3, 1, 2]),
        helper.make_node("Gather", ["rgb", graph.constant(np.array([2, 1, 0], np.int64))], ["planes"], axis=1),
    ]
    kept = list(graph.graph.node)
    del graph.graph.node[:]
    graph.graph.node.extend([*first, *kept])
    boxes, scores, labels = graph.best()
    swapped = graph.node("Gather", graph.shares(boxes), np.array([1, 0, 3, 2], np.int64), axis=2)
    numbers = graph.node("Cast", graph.node("Gather", CATEGORY, labels), to=1)
    return graph.give(
        detection_boxes=swapped, detection_classes=numbers, detection_scores=scores,
        num_detections=graph.node("Identity", np.array([BEST], np.float32)),
    )  # fmt: skip


def torchvision(graph: Graph) -> onnx.ModelProto:
    """torchvision's detectors: boxes (K, 4), labels (K,) by category, scores (K,)."""
    boxes, scores, labels = graph.best()
    numbers = graph.node("Gather", CATEGORY, graph.flat(labels))
    return graph.give(boxes=graph.flat(boxes, 4), scores=graph.flat(scores), labels=numbers)


def batched_rows(graph: Graph) -> onnx.ModelProto:
    """YOLOv7 with NMS in its graph: (K, 7), batch, box, class, score."""
    boxes, scores, labels = graph.best()
    columns = [graph.column(one) for one in (graph.node("Cast", labels, to=1), scores)]
    batch = np.zeros((1, BEST, 1), np.float32)
    table = graph.node("Concat", batch, boxes, *columns, axis=2)
    return graph.give(boxes_out=graph.flat(table, 7))


def labelled_rows(graph: Graph) -> onnx.ModelProto:
    """PaddleDetection with NMS in its graph: (K, 6), class, score, box."""
    boxes, scores, labels = graph.best()
    columns = [graph.column(one) for one in (graph.node("Cast", labels, to=1), scores)]
    return graph.give(boxes_out=graph.flat(graph.node("Concat", *columns, boxes, axis=2), 6))


MODELS: dict[str, Callable[[Graph], onnx.ModelProto]] = {
    "class columns": class_columns, "class columns, shares": partial(class_columns, share=True), "segmentation":
    segmentation, "objectness rows": objectness_rows, "cells": cells, "class rows": class_rows, "end to end":
    end_to_end, "queries": queries, "categories": categories, "sized lists": sized_lists, "counted lists":
    counted_lists, "tensorflow": tensorflow, "torchvision": torchvision, "batched rows": batched_rows, "labelled rows":
    labelled_rows,
}  # fmt: skip


def write(model: onnx.ModelProto, path: Path) -> Path:
    """The file of a model."""
    onnx.save(model, path)
    return path
