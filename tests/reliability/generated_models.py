"""Second fuzzer: bundles with ONNX files built node by node, Darknet networks, and torch checkpoints built key by key."""

from __future__ import annotations

import io
import pickle
import struct
import zipfile
from pathlib import Path
from random import Random
from typing import Any

import msgspec
import numpy as np
import onnx
import torch
from onnx import TensorProto, helper, numpy_helper

from edgemap.export import adopt, darknet, darknet_weights
from edgemap.export.detector import checkpoint as detector_checkpoint
from edgemap.export.detector.network import load_network
from edgemap.export.odometry import checkpoint as head_checkpoint
from edgemap.export.odometry.flow import FlowHead
from edgemap.export.odometry.paper import PaperHead
from edgemap.runtime.network import manifest as m
from edgemap.runtime.network.bundle import load_bundle
from reliability import drawing as d
from reliability.drawing import ValueSource
from reliability.workers import ReaderCase

SUBNET = "[net]\nwidth=32\nheight=32\n[convolutional]\nfilters=18\nsize=1\n[yolo]\nmask=0,1,2\nanchors=1,2,3,4,5,6\nclasses=1\n"


def cases(scratch: Path) -> list[ReaderCase]:
    """Models in every form that export and the robot read. scratch: unused here."""
    del scratch
    return [
        ReaderCase("Darknet cfg", _cfg, _use_cfg),
        ReaderCase("Darknet weights", _weights, _use_weights),
        ReaderCase("checkpoint, odometry", _head, _use_head),
        ReaderCase("checkpoint, detector", _detector, _use_detector),
        ReaderCase("ONNX to adopt", _adopted, _use_adopted),
        ReaderCase("bundle with its ONNX file", _bundle, _use_bundle),
    ]


# Bundles: manifest, contract and sum fit each other; the graph does what it likes.


def _bundle(random: Random) -> tuple[bytes, bytes]:
    draw = ValueSource(random, damage=random.choice((0.0, 0.01, 0.03, 0.1)))
    classes = tuple(m.ClassEntry(name=f"c{number}") for number in range(draw.pick((1, 2, 80))))
    side, rule = draw.pick((32, 64)), draw.pick(("yolov3", "yolox", "dfl"))
    cells, values = side // 32, 5 + len(classes)
    shape = {
        "yolov3": (1, values, cells, cells),
        "yolox": (1, cells * cells, values),
        "dfl": (1, values + 27, cells, cells),
    }[rule]
    detector = m.DetectorSpec(
        file="backbone.onnx",
        input=m.InputSpec(name="image", width=side, height=side, resize="stretch", colour="rgb", scale=1.0),
        decode=rule,  # type: ignore[arg-type]
        heads=(m.HeadSpec(name="head", shape=shape, strides=(32,), anchors=((9.0, 9.0),) if rule == "yolov3" else ()),),
        features=(),
        classes=classes,
    )
    model = _graph(draw, (1, 3, side, side), shape)
    if not draw.hurt():
        contract = m.contract_metadata(detector)
        helper.set_model_props(
            model,
            {
                m.METADATA_KEY: contract
                if not draw.hurt()
                else draw.pick(("", "{}", contract[:-1], contract * 2, "\x1b"))
            },
        )
    data = _protobuf(draw, model)
    text = m.Manifest(
        format=m.FORMAT,
        name="tiny",
        version="1",
        detector=detector,
        sha256={"backbone.onnx": _sum(data) if not draw.hurt() else "0" * 64},
    )
    return data, msgspec.json.encode(text)


def _sum(data: bytes) -> str:
    import hashlib

    return hashlib.sha256(data).hexdigest()


def _graph(draw: ValueSource, taken: tuple[int, ...], given: tuple[int, ...]) -> Any:
    """A graph from (1, 3, H, W) to the wanted shape, by way of a few nodes that may be anything."""
    kind = (
        TensorProto.FLOAT
        if not draw.hurt()
        else draw.pick((TensorProto.DOUBLE, TensorProto.INT64, TensorProto.STRING, 0, 99))
    )
    image, size = "image" if not draw.hurt() else draw.text(), int(np.prod(given))
    dims = [value if not draw.hurt() else draw.pick((0, -1, 2**31, 2**40, "N")) for value in taken]
    nodes = [helper.make_node("ReduceMean", [image], ["mean"], keepdims=0)]
    last = "mean"
    for number in range(draw.count(5)):
        op = (
            draw.pick(("Relu", "Sigmoid", "Exp", "Neg", "Sqrt", "Identity"))
            if not draw.hurt()
            else draw.pick(("Loop", "Bogus", "Relu\0", "Gather", "If", "PythonOp"))
        )
        nodes.append(
            helper.make_node(op, [last if not draw.hurt() else draw.pick(("image", "", "later", last))], [f"n{number}"])
        )
        last = f"n{number}"
    length = draw.pick((1, 4, size)) if not draw.hurt() else draw.pick((0, 10**9, 2**62))
    weights = [numpy_helper.from_array(np.array(given if not draw.hurt() else [length] * 4, np.int64), "shape")]
    nodes.append(helper.make_node("Expand", [last, "shape"], ["head" if not draw.hurt() else draw.text()]))
    if draw.hurt():
        nodes.append(helper.make_node("Constant", [], ["x"], value_string=b"\xff"))
    if draw.hurt():
        weights.append(_tensor(draw))
    output = helper.make_tensor_value_info(
        "head", kind, given if not draw.hurt() else tuple(value + 1 for value in given)
    )
    graph = helper.make_graph(
        nodes, draw.text().replace("\0", ""), [helper.make_tensor_value_info(image, kind, dims)], [output], weights
    )
    opset = draw.pick((11, 13, 17, 17, 21)) if not draw.hurt() else draw.pick((0, 1, 9, 24, 99, 2**31))
    return helper.make_model(
        graph,
        opset_imports=[helper.make_opsetid("" if not draw.hurt() else "x", opset)],
        ir_version=8 if not draw.hurt() else 99,
    )


def _tensor(draw: ValueSource) -> Any:
    """A constant whose numbers do not fit its shape, or that is kept in another file."""
    tensor = TensorProto(name="extra", data_type=draw.pick((1, 7, 10, 16, 77)), raw_data=draw.random.randbytes(12))
    tensor.dims.extend(draw.pick(([3], [10**6], [2**40], [-1], [2**31, 2**31], [0])))
    if draw.chance(0.4):
        tensor.ClearField("raw_data")
        tensor.data_location = TensorProto.EXTERNAL
        place = draw.pick(("/etc/passwd", "../../x", "w.bin", "/dev/zero", ""))
        tensor.external_data.extend(
            [
                onnx.StringStringEntryProto(key="location", value=place),
                onnx.StringStringEntryProto(key="length", value="9" * 20),
            ]
        )
    return tensor


def _protobuf(draw: ValueSource, model: Any) -> bytes:
    """The model's bytes, with fields of our own behind them: known ones twice, unknown ones, deep ones, false lengths."""
    data = model.SerializeToString()
    for _ in range(draw.count(2) if draw.hurt() else 0):
        field, value = (
            draw.pick((1, 7, 8, 14, 20, 99, 2**28)),
            draw.pick((b"", b"\xff" * 9, data[:200], b"\x0a\x03" * 50, b"\x0a\x7f")),
        )
        length = len(value) if not draw.hurt() else draw.pick((2**31, 2**63 - 1, len(value) + 5))
        data += _varint(field << 3 | draw.pick((2, 2, 0, 1, 3, 5))) + _varint(length) + value
    cut = draw.random.randrange(len(data) + 1)
    return (
        data if not draw.hurt() else draw.pick((data[:cut], data[:cut] + b"\xff" * 12 + data[cut:], b"", data + data))
    )


def _varint(value: int) -> bytes:
    out = bytearray()
    while value > 127:
        out.append(value & 127 | 128)
        value >>= 7
    return bytes([*out, value])


def _use_bundle(folder: Path, drawn: tuple[bytes, bytes]) -> None:
    model, text = drawn
    (folder / "backbone.onnx").write_bytes(model)
    (folder / "bundle.json").write_bytes(text)
    bundle = load_bundle(folder, threads=1)
    spec = bundle.manifest.detector
    shape = (1, 3, spec.input.height, spec.input.width)
    outputs = bundle.backbone.run({spec.input.name: np.zeros(shape, np.float32)})
    assert all(outputs[head.name].shape == head.shape for head in spec.heads)


def _adopted(random: Random) -> bytes:
    draw = ValueSource(random, damage=random.choice((0.0, 0.005, 0.02, 0.1)))
    side, classes = draw.pick((32, 64, 416)), draw.pick((1, 80))
    cells = sum((side // stride) ** 2 for stride in (8, 16, 32))
    return _protobuf(draw, _graph(draw, (1, 3, side, side), (1, cells, 5 + classes)))


def _use_adopted(folder: Path, data: bytes) -> None:
    path = folder / "a.onnx"
    path.write_bytes(data)
    _, contract = adopt.adopt(path)
    assert contract.heads


# Darknet.


def _cfg(random: Random) -> bytes:
    """Sections in an order that makes a network, with options in and out of range."""
    draw = ValueSource(random, damage=random.choice((0.0, 0.02, 0.05, 0.2)))

    def number(least: int, most: int) -> str:
        return (
            str(draw.whole(least, most))
            if not draw.hurt()
            else draw.pick((*d.ODD_NUMBERS, "0", "-1", "100001", "1000000000000", "", "1,2", "x"))
        )

    side = draw.pick((32, 64, 96))
    lines = [
        "[net]" if not draw.hurt() else draw.pick(("[network]", "net", "[net", "", "[NET]")),
        f"width={number(side, side)}",
        f"height={number(side, side)}",
        "channels=3",
    ]
    depth = draw.random.randrange(6)
    for index in range(depth):
        kind = draw.pick(
            (
                "convolutional",
                "convolutional",
                "convolutional",
                "maxpool",
                "upsample",
                "route",
                "shortcut",
                "dropout",
                "avgpool",
            )
        )
        if kind in ("upsample", "avgpool", "route", "shortcut") and not draw.chance(0.4):
            kind = "convolutional"
        lines.append(f"[{kind}]" if not draw.hurt() else draw.pick(("[lstm]", "[crop]", "[\x1b[2J]", f"[{kind}")))
        options = {
            "convolutional": [f"filters={number(1, 8)}", f"size={number(1, 3)}", f"stride={number(1, 1)}", "pad=1", f"activation={draw.pick(('leaky', 'linear', 'mish', 'relu'))}", f"batch_normalize={draw.pick((0, 1))}"],
            "maxpool": [f"size={number(2, 3)}", f"stride={number(1, 2)}"], "upsample": [f"stride={number(2, 2)}"],
            "route": [f"layers={draw.pick(('-1', '-1', '0', '-2', '-1,0', '99', '', '-1,-1'))}", f"groups={number(1, 1)}"],
            "shortcut": [f"from={draw.pick(('-1', '-2', '-3', '0', '99'))}", "activation=linear"], "dropout": ["probability=.5"], "avgpool": [],
        }[kind]  # fmt: skip
        if draw.hurt():
            options.append(
                draw.pick(
                    (
                        "groups=3",
                        "dilation=2",
                        "antialiasing=1",
                        "weights_type=per_feature",
                        "activation=swish",
                        "=",
                        "a",
                        "a=b=c",
                        "# c",
                        "size=\x1b",
                    )
                )
            )
        lines += [line for line in options if not draw.hurt()]
        del index
    classes, anchors = draw.pick((1, 3)), draw.pick((1, 3))
    lines += [
        "[convolutional]",
        f"filters={number(anchors * (classes + 5), anchors * (classes + 5))}",
        "size=1",
        "activation=linear",
        "[yolo]",
    ]
    lines += [
        f"mask={','.join(map(str, range(anchors))) if not draw.hurt() else draw.pick(('9', '-1', 'x', ''))}",
        f"classes={number(classes, classes)}",
    ]
    lines.append("anchors=" + ",".join(number(1, 300) for _ in range(2 * anchors if not draw.hurt() else 3)))
    if draw.hurt():
        draw.random.shuffle(lines)
    return d.encoded(draw, draw.pick(("\n", "\n", "\r\n")).join(lines) + "\n")


def _use_cfg(folder: Path, data: bytes) -> None:
    path = folder / "a.cfg"
    path.write_bytes(data)
    network = darknet.Darknet.from_cfg(path).eval()
    if network.channels == 3 and network.width * network.height <= 96 * 96:
        with torch.no_grad():
            outputs = network(torch.zeros(1, 3, network.height, network.width))
        assert [tuple(output.shape[1:]) for output in outputs] == [head.shape for head in network.heads]


def _weights(random: Random) -> bytes:
    draw = ValueSource(random)
    network = darknet.Darknet.from_cfg(SUBNET)
    version = (
        (0, draw.pick((1, 2)), 0)
        if not draw.hurt()
        else tuple(draw.pick((0, 1, 999, 1000, -1, 2**31 - 1)) for _ in range(3))
    )
    wide = version[0] * 10 + version[1] >= 2 if not draw.hurt() else draw.chance(0.5)
    head = struct.pack("<iii", *version) + struct.pack("<Q" if wide else "<I", draw.pick((0, 1, 2**32 - 1)))
    values = np.frombuffer(draw.random.randbytes(4 * darknet_weights.value_count(network)), np.float32).copy()
    values[~np.isfinite(values)] = 0.5
    if draw.hurt():
        values[draw.random.randrange(len(values))] = draw.pick((np.nan, np.inf, -np.inf))
    body = values.tobytes()
    return head + (body if not draw.hurt() else draw.pick((body[:-4], body + b"\0" * 4, body + b"\0", b"", body[:-1])))


def _use_weights(folder: Path, data: bytes) -> None:
    path = folder / "a.weights"
    path.write_bytes(data)
    network = darknet.Darknet.from_cfg(SUBNET)
    darknet_weights.load_weights(network, path)
    assert all(bool(torch.isfinite(tensor).all()) for tensor in darknet_weights.tensors_in_file_order(network))


# Torch checkpoints.


def _head(random: Random) -> bytes:
    draw = ValueSource(random, damage=random.choice((0.0, 0.01, 0.03, 0.1)))
    record = d.of_type(draw, head_checkpoint._OdometryRecord)
    if not isinstance(record, dict):
        return _saved(draw, record)
    kind = draw.pick(("paper", "flow"))
    record |= {
        "format": head_checkpoint.FORMAT,
        "kind": kind,
        "shape": [1, 4, 8, 8],
        "hidden": [2],
        "dense": 3,
        "kernel": 3,
        "stride": 8,
    }
    network = PaperHead((1, 4, 8, 8), (2,), 3, 3, 0.1) if kind == "paper" else FlowHead((1, 4, 8, 8), 8)
    if draw.hurt():
        record[draw.pick(("shape", "hidden", "dense", "kernel", "stride"))] = draw.pick(
            ([4096] * 4, [1], 4096, 31, 0, -1, None, "x", [1, 1, 1, 1])
        )
    return _saved(draw, record | {"state_dict": _tensors(draw, network.state_dict())})


def _detector(random: Random) -> bytes:
    draw = ValueSource(random, damage=random.choice((0.0, 0.01, 0.03, 0.1)))
    graph, manifest = _bundle(random)
    record = {
        "format": detector_checkpoint.FORMAT if not draw.hurt() else draw.text(),
        "manifest": manifest.decode() if not draw.hurt() else draw.text(),
        "graph": torch.frombuffer(bytearray(graph or b"x"), dtype=torch.uint8) if not draw.hurt() else torch.ones(2, 2),
    }
    return _saved(draw, record)


def _tensors(draw: ValueSource, weights: dict[str, Any]) -> Any:
    """Weights by name: whole, or with some that are none."""
    found: dict[Any, Any] = {
        name: tensor.half() if tensor.is_floating_point() and draw.chance(0.3) else tensor
        for name, tensor in weights.items()
    }
    if not draw.hurt():
        if draw.hurt():
            name = draw.pick(list(found))
            found[name] = draw.pick((
                1, "x", [1], torch.zeros(1), torch.zeros(0), torch.full_like(found[name].float(), torch.nan), torch.zeros(1).expand(10**9),
                torch.zeros(2, 2).to_sparse(), torch.zeros(3, dtype=torch.complex64), torch.zeros(3, dtype=torch.bool), torch.empty(10, device="meta"),
                found[name].double(), found[name].flatten(),
            ))  # fmt: skip
        if draw.hurt():
            found[draw.pick((1, "more", "\x1b[2J", ("a",)))] = torch.zeros(2)
        return found
    return draw.pick((None, [], [1], {}, "x", {1: torch.zeros(1)}, torch.zeros(3)))


class _Evil:
    """What a pickle of a stranger does when it is opened by one who trusts it."""

    def __reduce__(self) -> tuple[Any, ...]:
        return (print, ("code of the file ran",))


def _saved(draw: ValueSource, document: Any) -> bytes:
    """A torch file: zip archive with its pickle, or in its parts."""
    document = _plain(document)
    out = io.BytesIO()
    torch.save(
        document if not draw.hurt() else draw.pick((_Evil(), {"state_dict": _Evil()}, [document], 1)),
        out,
        _use_new_zipfile_serialization=not draw.hurt(),
    )
    data = out.getvalue()
    if not draw.hurt() or data[:2] != b"PK":
        return data if not draw.hurt() else data[: draw.random.randrange(len(data))]
    parts, again = zipfile.ZipFile(io.BytesIO(data)), io.BytesIO()
    with zipfile.ZipFile(again, "w", draw.pick((zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED))) as archive:
        for name in parts.namelist():
            content = parts.read(name)
            if draw.hurt():
                continue
            if name.endswith("data.pkl") and draw.chance(0.4):
                content = draw.pick(
                    (
                        pickle.dumps(_Evil()),
                        b"\x80\x02" + b"(" * 5000,
                        b"\x80\x02" + b"]" * 99999 + b".",
                        content[:-1],
                        b"cos\nsystem\n(S'x'\ntR.",
                        b"\x80\x02\x8a\xff" + b"\xff" * 255 + b".",
                    )
                )
            archive.writestr(
                name if not draw.hurt() else draw.pick(("../x", "a/data.pkl", "archive/version", "/x")),
                content if draw.chance(0.8) else content[: len(content) // 2],
            )
            if draw.hurt():
                archive.writestr("archive/zeros", b"\0" * (1 << 20))
    return again.getvalue() if not draw.hurt() else b"x" * 100 + again.getvalue()


def _plain(value: Any) -> Any:
    """Values that torch saves as its own reader takes them: texts for raw JSON."""
    if isinstance(value, dict):
        return {_plain(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_plain(item) for item in value]
    return "".join(value) if isinstance(value, str) else value


def _use_head(folder: Path, data: bytes) -> None:
    path = folder / "a.pt"
    path.write_bytes(data)
    head_checkpoint.load_head(path)


def _use_detector(folder: Path, data: bytes) -> None:
    path = folder / "a.pt"
    path.write_bytes(data)
    assert load_network(str(path)).names
