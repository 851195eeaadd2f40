"""The network against YOLOX-Nano's own file in onnxruntime, and its raw heads against the runtime's decoding."""

import numpy as np
import pytest

torch = pytest.importorskip("torch")

from edgemap.export.detector.blocks import Refinement, convolutions, fold_norms  # noqa: E402
from edgemap.export.detector.boxes import cells_of, decode, flatten  # noqa: E402
from edgemap.export.detector.checkpoint import DetectorCheckpoint, load_detector, save_detector  # noqa: E402
from edgemap.export.detector.classes import NAMES  # noqa: E402
from edgemap.export.detector.network import ANCHORS, SCALE_XY, STRIDES, Nano  # noqa: E402
from edgemap.export.detector.start import load_yolox  # noqa: E402
from edgemap.export.detector.validate import nano_detector  # noqa: E402
from edgemap.export.errors import ExportError  # noqa: E402
from edgemap.runtime.decode import Decoder  # noqa: E402
from edgemap.runtime.drives.coco import COCO_NAMES  # noqa: E402
from edgemap.runtime.preprocess import place  # noqa: E402


@pytest.fixture(scope="module")
def yolox(shared_data):
    return shared_data / "weights/yolox_nano.onnx"


def test_the_start_computes_what_yolox_nano_computes(yolox):
    """Scores and sizes are YOLOX's; its linear centre offset is our sigmoid's tangent, so raw values map one to one."""
    import onnxruntime

    network = Nano(len(NAMES), norm=False).eval()
    load_yolox(network, yolox, NAMES)
    session = onnxruntime.InferenceSession(str(yolox))
    picture = np.random.default_rng(0).integers(0, 256, (1, 3, 416, 416)).astype(np.float32)
    theirs = np.asarray(session.run(None, {session.get_inputs()[0].name: picture})[0])[0]
    rows = [COCO_NAMES.index(name) for name in NAMES]
    first = 0
    with torch.no_grad():
        heads = network(torch.from_numpy(picture))
    for head, stride, anchor in zip(heads, STRIDES, ANCHORS, strict=True):
        assert head.shape == (1, 23, 416 // stride, 416 // stride)
        ours = head[0].reshape(23, -1).T.double().numpy()
        part = theirs[first : first + len(ours)].astype(float)
        first += len(ours)
        np.testing.assert_allclose(1 / (1 + np.exp(-ours[:, 4])), part[:, 4], atol=1e-5)
        np.testing.assert_allclose(1 / (1 + np.exp(-ours[:, 5:])), part[:, 5:][:, rows], atol=1e-5)
        np.testing.assert_allclose(np.exp(ours[:, 2:4]) * anchor, np.exp(part[:, 2:4]) * stride, rtol=1e-3)
        np.testing.assert_allclose(ours[:, :2] * SCALE_XY / 4 + 0.5, part[:, :2], atol=1e-3)


def test_other_files_are_refused_by_shape(yolox, tmp_path):
    with pytest.raises(ExportError, match="without batch normalisation"):
        load_yolox(Nano(18), yolox, NAMES)
    import onnx

    model = onnx.load(yolox)
    weights = {item.name: item for item in model.graph.initializer}
    first = next(node for node in model.graph.node if node.op_type == "Conv")
    old = onnx.numpy_helper.to_array(weights[first.input[1]])
    weights[first.input[1]].CopyFrom(onnx.numpy_helper.from_array(np.concatenate([old, old]), first.input[1]))
    onnx.save(model, tmp_path / "odd.onnx")
    with pytest.raises(ExportError):
        load_yolox(Nano(18, norm=False), tmp_path / "odd.onnx", NAMES)


def test_torch_and_runtime_decode_the_same_boxes():
    """One strong cell per head, random raw values: the training's boxes are the robot's."""
    generator = torch.Generator().manual_seed(4)
    heads = [torch.randn(1, 23, 96 // s, 128 // s, generator=generator) * 0.5 for s in STRIDES]
    for number, head in enumerate(heads):
        head[:, 4] = -20.0
        head[:, 4, number, number + 1] = 10.0
        head[:, 5:] = -20.0
        head[:, 5 + number, number, number + 1] = 10.0
    boxes = decode(flatten(heads), cells_of(heads))[0]
    strong = flatten(heads)[0, :, 4] > 0
    detector = nano_detector(NAMES, 128, 96)
    outputs = {spec.name: head.numpy() for spec, head in zip(detector.heads, heads[::-1], strict=True)}
    found = Decoder(detector, 0.5, 0.9)(outputs, place(detector.input, 128, 96))
    order = np.argsort(found.class_ids)
    expected = np.clip(boxes[strong].numpy(), 0, [128, 96, 128, 96])
    np.testing.assert_allclose(found.boxes[order], expected, atol=1e-3)


def test_folding_normalisation_changes_no_output():
    torch.manual_seed(0)
    network = Nano(3, norm=True)
    for part in convolutions(network):
        norm = part.norm
        assert isinstance(norm, torch.nn.BatchNorm2d)
        for tensor, low, high in ((norm.running_mean, -1.0, 1.0), (norm.running_var, 0.5, 2.0)):
            assert isinstance(tensor, torch.Tensor)
            torch.nn.init.uniform_(tensor, low, high)
        torch.nn.init.uniform_(norm.weight, 0.5, 1.5)
        torch.nn.init.uniform_(norm.bias, -1.0, 1.0)
    network.eval()
    picture = torch.rand(1, 3, 64, 64)
    with torch.no_grad():
        before = network(picture)
        fold_norms(network)
        after = network(picture)
    for a, b in zip(before, after, strict=True):
        torch.testing.assert_close(a, b, rtol=1e-3, atol=1e-3)
    assert not any(isinstance(part.norm, torch.nn.BatchNorm2d) for part in convolutions(network))


def test_within_the_parameter_limit():
    assert sum(p.numel() for p in Nano(len(NAMES), norm=False).parameters()) == 1_323_125


def test_a_refinement_begins_idle_and_learns():
    network = Nano(3, norm=False).eval()
    picture = torch.rand(1, 3, 64, 64) * 255.0
    maps = network.trunk(picture)
    for head, refined, x in zip(network.heads, network.look(maps), maps, strict=True):
        assert torch.equal(head(x), refined)
    torch.stack([head.square().mean() for head in network.look(maps)]).sum().backward()
    for part in network.refinements:
        assert isinstance(part, Refinement)
        assert part.spread.weight.grad is not None
        assert float(part.spread.weight.grad.abs().max()) > 0.0


def test_weights_of_before_the_refinements_compute_what_they_did(tmp_path):
    network = Nano(len(NAMES), norm=False).eval()
    path = tmp_path / "early.pt"
    save_detector(DetectorCheckpoint(network, NAMES, 64, "none", "none", ()), path)
    document = torch.load(path, weights_only=True)
    document["state_dict"] = {k: v for k, v in document["state_dict"].items() if not k.startswith("refinements.")}
    torch.save(document, path)
    picture = torch.rand(1, 3, 64, 64) * 255.0
    with torch.no_grad():
        for ours, theirs in zip(load_detector(path).network(picture), network(picture), strict=True):
            torch.testing.assert_close(ours, theirs, rtol=2e-3, atol=2e-2)
    del document["state_dict"]["stem.conv.weight"]
    torch.save(document, path)
    with pytest.raises(ExportError, match="weights do not fit"):
        load_detector(path)
