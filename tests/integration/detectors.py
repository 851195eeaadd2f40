# pyright: reportMissingImports=false
"""Run in another project's environment: a detector of random weights as its package exports it, and its own boxes.

    python detectors.py NAME FOLDER

writes FOLDER/model.onnx, and FOLDER/boxes.npz: the input tensor, and xyxy px, scores and labels of the package's own
postprocessing of it.
"""

import os
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import onnxruntime
import torch

torch.manual_seed(0)
torch.set_num_threads(2)
SIDE = 320


def picture(side: int = SIDE) -> np.ndarray:
    """Random patches, RGB (side, side, 3)."""
    small = np.random.default_rng(0).integers(0, 256, (side // 16, side // 16, 3), np.uint8)
    return small.repeat(16, 0).repeat(16, 1)


def tensor_of(rgb: np.ndarray) -> torch.Tensor:
    return torch.from_numpy(rgb.transpose(2, 0, 1)[None].copy()).float() / 255.0


def torchvision_with_nms() -> None:
    """Torchvision's wheels have kernels for CUDA; beside a torch without it, suppression is written in torch."""

    def nms(boxes: torch.Tensor, scores: torch.Tensor, iou_threshold: float) -> torch.Tensor:
        kept, order = [], scores.argsort(descending=True)
        areas = (boxes[:, 2:] - boxes[:, :2]).prod(1)
        while len(order):
            best, order = order[0], order[1:]
            kept.append(best)
            sides = torch.minimum(boxes[best, 2:], boxes[order, 2:]) - torch.maximum(boxes[best, :2], boxes[order, :2])
            shared = sides.clamp(min=0).prod(1)
            order = order[shared / (areas[best] + areas[order] - shared) <= iou_threshold]
        return torch.stack(kept) if kept else torch.zeros(0, dtype=torch.int64)

    library = torch.library.Library("torchvision", "FRAGMENT")
    for operator in ("nms", "qnms"):
        library.define(f"{operator}(Tensor dets, Tensor scores, float iou_threshold) -> Tensor")
        library.impl(operator, nms, "CPU")
    torchvision_with_nms.kept = library  # type: ignore[attr-defined]
    from torchvision.ops import boxes

    def has_ops() -> None:
        return None

    boxes._assert_has_ops = has_ops


def ultralytics(name: str, folder: Path) -> tuple:
    os.environ |= {"YOLO_CONFIG_DIR": str(folder), "YOLO_AUTOINSTALL": "false", "YOLO_OFFLINE": "true"}
    torchvision_with_nms()
    from ultralytics import YOLO

    os.chdir(folder)
    model = YOLO(f"{name}.yaml")
    for key, bias in model.model.model[-1].named_parameters():
        if key.endswith("bias") and len(bias) == 80:
            torch.nn.init.normal_(bias, -2.0, 1.0)  # as if trained: random weights give no score
    rgb = picture()
    made = Path(model.export(format="onnx", imgsz=SIDE, simplify=False))
    made.rename(folder / "model.onnx")
    found = model.predict(rgb[:, :, ::-1].copy(), imgsz=SIDE, conf=0.2, verbose=False)[0].boxes
    return tensor_of(rgb), found.xyxy, found.conf, found.cls


def transformers(name: str, folder: Path) -> tuple:
    import transformers as package

    kind = {"rt-detr": "RTDetr", "d-fine": "DFine"}[name]
    config = getattr(package, f"{kind}Config")(num_labels=80)
    model = getattr(package, f"{kind}ForObjectDetection")(config).eval()
    tensor = tensor_of(picture())

    class Outputs(torch.nn.Module):
        def __init__(self) -> None:
            super().__init__()
            self.model = model

        def forward(self, pixel_values: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
            found = self.model(pixel_values=pixel_values)
            return found.logits, found.pred_boxes

    torch.onnx.export(
        Outputs().eval(), (tensor,), str(folder / "model.onnx"), input_names=["pixel_values"],
        output_names=["logits", "pred_boxes"], opset_version=17, dynamo=False,
    )  # fmt: skip
    # Of the file's own outputs: random weights choose other queries in torch.
    session = onnxruntime.InferenceSession(folder / "model.onnx")
    logits, boxes = map(torch.from_numpy, session.run(None, {"pixel_values": tensor.numpy()}))
    outputs = SimpleNamespace(logits=logits, pred_boxes=boxes)
    processor = package.RTDetrImageProcessor()
    found = processor.post_process_object_detection(outputs, threshold=0.0, target_sizes=[(SIDE, SIDE)])[0]
    return tensor, found["boxes"], found["scores"], found["labels"]


def rfdetr(name: str, folder: Path) -> tuple:
    torchvision_with_nms()
    from rfdetr import RFDETRNano
    from rfdetr.models.postprocess import PostProcess

    network = RFDETRNano(pretrain_weights=None, device="cpu").model.model.eval()
    network.export()
    tensor = tensor_of(picture(384))
    torch.onnx.export(
        network, (tensor,), str(folder / "model.onnx"), input_names=["input"], output_names=["dets", "labels"],
        opset_version=17, dynamo=False,
    )  # fmt: skip
    session = onnxruntime.InferenceSession(folder / "model.onnx")  # as for transformers
    boxes, logits = map(torch.from_numpy, session.run(None, {"input": tensor.numpy()}))
    found = PostProcess()({"pred_logits": logits, "pred_boxes": boxes}, torch.tensor([[384, 384]]))[0]
    return tensor, found["boxes"], found["scores"], found["labels"]


def torchvision(name: str, folder: Path) -> tuple:
    torchvision_with_nms()
    from torchvision.models.detection import ssdlite320_mobilenet_v3_large

    untrained = {"weights": None, "weights_backbone": None, "num_classes": 91}
    model = ssdlite320_mobilenet_v3_large(**untrained, score_thresh=0.05, topk_candidates=20).eval()
    for kernel in (one for one in model.parameters() if one.dim() == 4):
        torch.nn.init.kaiming_normal_(kernel)  # the package's own start lets every activation vanish
    tensor = tensor_of(picture())
    torch.onnx.export(
        model, ([tensor[0]],), str(folder / "model.onnx"), input_names=["image"],
        output_names=["boxes", "scores", "labels"], opset_version=17, dynamo=False,
    )  # fmt: skip
    with torch.no_grad():
        found = model([tensor[0]])[0]
    return tensor, found["boxes"], found["scores"], found["labels"]


PACKAGES = {"yolov8n": ultralytics, "yolo11n": ultralytics, "yolov10n": ultralytics, "yolo26n": ultralytics,
            "rt-detr": transformers, "d-fine": transformers, "rf-detr": rfdetr, "ssdlite": torchvision}  # fmt: skip

if __name__ == "__main__":
    name, out = sys.argv[1], Path(sys.argv[2]).resolve()
    tensor, *found = PACKAGES[name](name, out)
    boxes, scores, labels = (np.asarray(torch.as_tensor(one).cpu(), np.float64) for one in found)
    np.savez(out / "boxes.npz", tensor=tensor.numpy(), boxes=boxes, scores=scores, labels=labels)
