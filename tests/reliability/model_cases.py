"""Models in every form that export and the robot read, mutated: bundles, ONNX files, Darknet networks, checkpoints."""

import json
from io import BytesIO
from pathlib import Path
from random import Random
from typing import Any

import torch

from edgemap.export.adopt import load_onnx
from edgemap.export.darknet import Darknet
from edgemap.export.darknet_weights import load_weights, random_weights, save_weights
from edgemap.export.detector.network import FORMAT, load_network
from edgemap.export.odometry.checkpoint import HeadCheckpoint, load_head, save_head
from edgemap.export.odometry.paper import PaperHead
from edgemap.runtime.network.bundle import load_bundle
from edgemap.runtime.network.manifest_file import MANIFEST_NAME, read_manifest, sha256_file
from reliability.mutations import json_bytes, mutated_bytes, mutated_rows, mutated_tree
from reliability.tiny_bundle import write_tiny
from reliability.workers import ReaderCase, from_file

CFG = """[net]
width=64
height=64
channels=3
[convolutional]
batch_normalize=1
filters=8
size=3
stride=2
pad=1
activation=leaky
[maxpool]
size=2
stride=2
[convolutional]
filters=16
size=3
stride=1
pad=1
groups=2
activation=mish
[route]
layers=-1,-2
[route]
layers=-2
[shortcut]
from=-3
activation=linear
[upsample]
stride=2
[avgpool]
[route]
layers=5
[convolutional]
filters=16
size=1
activation=linear
[yolo]
mask=0,1
anchors=10,14, 23,27, 37,58
classes=3
num=3
scale_x_y=1.05
"""


def model_cases(scratch: Path) -> list[ReaderCase]:
    """scratch: a folder for what valid documents are made from."""
    torch.set_num_threads(1)  # threads do not survive the fork of a worker
    folder = write_tiny(scratch / "tiny")
    manifest, model = json.loads((folder / MANIFEST_NAME).read_text()), (folder / "backbone.onnx").read_bytes()

    def summed(at: Path, data: bytes) -> object:
        (at / "backbone.onnx").write_bytes(data)
        document = manifest | {"sha256": {"backbone.onnx": sha256_file(at / "backbone.onnx")}}
        (at / MANIFEST_NAME).write_text(json.dumps(document))
        return load_bundle(at, threads=1)

    network = Darknet.from_cfg(CFG)
    random_weights(network)
    save_weights(network, scratch / "a.weights")
    weights = (scratch / "a.weights").read_bytes()
    torch.manual_seed(0)
    save_head(HeadCheckpoint(PaperHead((1, 2, 3, 3), (2,), 4), "tiny", "head"), scratch / "head.pt")
    packed = (scratch / "head.pt").read_bytes()
    tree = torch.load(scratch / "head.pt", weights_only=True)
    tree["state_dict"] = {name: tensor.tolist() for name, tensor in tree["state_dict"].items()}
    tree = json.loads(json.dumps(tree))

    def tensors(value: Any, random: Random) -> Any:
        try:
            made = torch.tensor(value, dtype=torch.float32)
        except (ValueError, TypeError, RuntimeError, OverflowError):
            return value
        return (
            made.to_sparse()
            if random.random() < 0.005
            else made.expand(2, *made.shape)
            if random.random() < 0.01
            else made
        )

    def checkpoint(random: Random) -> bytes:
        if random.random() < 0.4:
            return mutated_bytes(random, packed)
        document = mutated_tree(random, tree)
        held = document.get("state_dict") if isinstance(document, dict) else None
        if isinstance(held, dict):
            document["state_dict"] = {name: tensors(value, random) for name, value in held.items()}
        stream = BytesIO()
        torch.save(document, stream)
        return stream.getvalue()

    def onnx_file(random: Random) -> bytes:
        if random.random() < 0.8:
            return mutated_bytes(random, model)
        data = bytearray(model)  # one byte: the message most often stays whole
        data[random.randrange(len(data))] = random.randrange(256)
        return bytes(data)

    trained = manifest | {"sha256": {}}

    def detector(random: Random) -> bytes:
        graph = mutated_bytes(random, model) if random.random() < 0.3 else model
        held: Any = {"manifest": json_bytes(random, trained).decode(errors="replace"), "format": FORMAT}
        held = held if random.random() < 0.7 else mutated_tree(random, held)
        if isinstance(held, dict):
            held["graph"] = torch.frombuffer(bytearray(graph), dtype=torch.uint8)
        stream = BytesIO()
        torch.save(held, stream)
        return mutated_bytes(random, stream.getvalue()) if random.random() < 0.2 else stream.getvalue()

    return [
        ReaderCase(
            "bundle.json", lambda random: json_bytes(random, manifest),
            from_file(MANIFEST_NAME, lambda path: read_manifest(path.parent)),
        ),
        ReaderCase("ONNX in a bundle", lambda random: mutated_bytes(random, model), summed),
        ReaderCase("ONNX to adopt", onnx_file, from_file("a.onnx", load_onnx)),
        ReaderCase(
            "Darknet weights",
            lambda random: mutated_bytes(random, weights[:20]) + weights[20:] if random.random() < 0.5
            else mutated_bytes(random, weights),
            from_file("a.weights", lambda path: load_weights(network, path)),
        ),
        ReaderCase(
            "Darknet cfg", lambda random: mutated_rows(random, CFG.encode()), from_file("a.cfg", Darknet.from_cfg)
        ),
        ReaderCase("checkpoint, odometry", checkpoint, from_file("a.pt", load_head)),
        ReaderCase("checkpoint, detector", detector, from_file("a.pt", lambda path: load_network(str(path)))),
    ]  # fmt: skip
