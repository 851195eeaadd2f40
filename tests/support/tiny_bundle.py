"""A bundle of a few hundred bytes that loads: where fuzzing of ONNX files starts from."""

from pathlib import Path

import numpy as np

from edgemap.runtime.network.manifest import (
    METADATA_KEY,
    ClassEntry,
    DetectorSpec,
    FeatureSpec,
    HeadSpec,
    InputSpec,
    Manifest,
    contract_metadata,
)
from edgemap.runtime.network.manifest_file import FORMAT, sha256_file, write_manifest


def write_tiny(folder: Path) -> Path:
    """Write a backbone whose one head is a convolution of the picture, and its manifest."""
    import onnx
    from onnx import TensorProto, helper, numpy_helper

    shape = (1, 7, 2, 2)
    detector = DetectorSpec(
        file="backbone.onnx",
        input=InputSpec(name="image", width=64, height=64, resize="stretch", colour="rgb", scale=1 / 255),
        decode="yolov3",
        heads=(HeadSpec(name="head", shape=shape, strides=(32,), anchors=((20.0, 30.0),)),),
        features=(FeatureSpec(name="head", shape=shape, stride=32),),
        classes=(ClassEntry(name="chair"), ClassEntry(name="person", mapped=False)),
    )
    weights = numpy_helper.from_array(np.zeros((7, 3, 1, 1), np.float32), "w")
    graph = helper.make_graph(
        [helper.make_node("Conv", ["image", "w"], ["head"], kernel_shape=[1, 1], strides=[32, 32])],
        "tiny",
        [helper.make_tensor_value_info("image", TensorProto.FLOAT, (1, 3, 64, 64))],
        [helper.make_tensor_value_info("head", TensorProto.FLOAT, shape)],
        [weights],
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    helper.set_model_props(model, {METADATA_KEY: contract_metadata(detector)})
    folder.mkdir(parents=True, exist_ok=True)
    onnx.save(model, folder / "backbone.onnx")
    sums = {"backbone.onnx": sha256_file(folder / "backbone.onnx")}
    write_manifest(folder, Manifest(format=FORMAT, name="tiny", version="1", detector=detector, sha256=sums))
    return folder
