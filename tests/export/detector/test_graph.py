"""The ONNX network that torch trains: what it computes, what it leaves alone, and its way back to a bundle."""

from pathlib import Path

import msgspec
import numpy as np
import onnx
import onnxruntime as ort
import pytest

torch = pytest.importorskip("torch")


from edgemap import models  # noqa: E402
from edgemap.export.backbones import trained_backbone  # noqa: E402
from edgemap.export.detector.boxes import read_heads  # noqa: E402
from edgemap.export.detector.graph import Graph  # noqa: E402
from edgemap.export.detector.network import TorchNetwork, load_detector, load_network  # noqa: E402
from edgemap.export.errors import ExportError  # noqa: E402
from edgemap.export.exporter import export_backbone  # noqa: E402
from edgemap.runtime.network.bundle import load_bundle  # noqa: E402
from edgemap.runtime.network.decode import Decoder  # noqa: E402
from edgemap.runtime.network.manifest import HeadSpec  # noqa: E402
from edgemap.runtime.network.manifest_file import read_manifest  # noqa: E402
from edgemap.runtime.network.preprocess import Preprocessor, place  # noqa: E402

SHIPPED = ("edgemap-pico", "edgemap-nano")
MODELS = Path(models.__file__).parent


def changed(name):
    """A network of which every weight that may learn has changed, as a training leaves it."""
    network = load_network(str(MODELS / name))
    generator = torch.Generator().manual_seed(3)
    with torch.no_grad():
        for parameter in network.parameters():
            if parameter.requires_grad:
                parameter.mul_(1.0 + 0.02 * torch.randn(parameter.shape, generator=generator))
    return network


def outputs(model: onnx.ModelProto, tensor: np.ndarray) -> dict[str, np.ndarray]:
    session = ort.InferenceSession(model.SerializeToString(), providers=["CPUExecutionProvider"])
    names = [value.name for value in model.graph.output]
    fed = {session.get_inputs()[0].name: tensor}
    return {name: np.asarray(value) for name, value in zip(names, session.run(names, fed), strict=True)}


@pytest.mark.parametrize("name", SHIPPED)
def test_torch_computes_what_onnxruntime_does(name):
    model, manifest = load_detector(str(MODELS / name))
    spec = manifest.detector.input
    mean, std = (np.reshape(values, (3, 1, 1)) for values in (spec.mean, spec.std))
    pixels = np.random.default_rng(0).uniform(0, 255, (1, 3, 416, 416))
    picture = ((pixels * spec.scale - mean) / std).astype(np.float32)
    graph = Graph(model)
    with torch.no_grad():
        ours = dict(zip(graph.outputs, graph(torch.from_numpy(picture)), strict=True))
    for output, value in outputs(model, picture).items():
        np.testing.assert_allclose(ours[output].numpy(), value, atol=1e-4 * np.abs(value).max(), err_msg=output)


@pytest.mark.parametrize("name", SHIPPED)
def test_scores_and_boxes_are_the_runtime_s(name):
    """All boxes of a picture, best first, nothing suppressed, as the runtime decodes them."""
    _, manifest = load_detector(str(MODELS / name))
    check_decode(manifest.detector, tuple(random_output(head.shape) for head in manifest.detector.heads))


def test_heads_of_three_anchors_are_read_as_the_runtime_does():
    """YOLOv3's own: three anchors of other sides than high, a cell's box never leaves it."""
    _, manifest = load_detector("edgemap-nano")
    anchors = ((10.0, 13.0), (33.0, 23.0), (62.0, 119.0))
    head = HeadSpec(name="h", shape=(1, 3 * 23, 13, 13), strides=(32,), anchors=anchors, scale_xy=1.0)
    detector = msgspec.structs.replace(manifest.detector, heads=(head,))
    rows = check_decode(detector, (random_output(head.shape),))
    assert rows.reach.unique().tolist() == [0.5]


def random_output(shape):
    value = np.random.default_rng(5).standard_normal(shape).astype(np.float32)
    return 1.0 / (1.0 + np.exp(-value)) if len(shape) == 3 else value  # YOLOX's scores are probabilities


def check_decode(detector, found):
    size = (detector.input.height, detector.input.width)
    named = {head.name: value for head, value in zip(detector.heads, found, strict=True)}
    truth = Decoder(detector, 0.02, 1.0)(named, place(detector.input, size[1], size[0]))
    rows = read_heads(tuple(map(torch.from_numpy, found)), detector, size)
    scores, labels = (value.numpy() for value in rows.scores[0].sigmoid().max(1))
    boxes = np.clip(rows.boxes[0].numpy(), 0.0, size[0])
    assert len(truth) > 50
    for box, score, label in zip(truth.boxes, truth.scores, truth.class_ids, strict=True):
        same = (np.abs(scores - score) < 1e-4) & (labels == label)
        assert np.abs(boxes[same] - box).max(1, initial=0.0).min(initial=9.0) < 0.05
    return rows


def test_a_copy_is_another_network(start):
    image = torch.rand(1, 3, 64, 64) * 255.0
    before = start(image)[0].detach()
    other = start.copy()
    with torch.no_grad():
        for parameter in other.parameters():
            parameter.mul_(1.1)
    assert torch.equal(start(image)[0], before)
    assert not torch.allclose(other(image)[0], before, atol=0.01)


def test_what_is_learnt_is_what_the_robot_runs(tmp_path, brief):
    """best.pt, its bundle, and the runtime's outputs: torch's."""
    network, shipped = changed("edgemap-pico"), read_manifest(MODELS / "edgemap-pico")
    network.save(tmp_path / "best.pt", {"validation": {"ap50": 0.5}})
    folder = export_backbone(str(tmp_path / "best.pt"), tmp_path / "mine")
    manifest = read_manifest(folder)
    assert (manifest.name, manifest.odometry) == ("mine", {})
    assert manifest.measured["validation"] == {"ap50": 0.5}
    for field in ("licence", "sources", "confidence", "sure_confidence"):
        assert getattr(manifest, field) == getattr(shipped, field), field
    # The floor's head reads the detector of before.
    assert manifest.detector == msgspec.structs.replace(shipped.detector, floor=None)
    image = np.random.default_rng(2).integers(0, 256, (416, 416, 3)).astype(np.uint8)
    tensor, _ = Preprocessor(manifest.detector.input)(image)
    found = load_bundle(folder).backbone.run({manifest.detector.input.name: tensor})
    with torch.no_grad():
        wanted = network(torch.from_numpy(image).permute(2, 0, 1)[None])
    for spec, head in zip(manifest.detector.heads, wanted, strict=True):
        np.testing.assert_allclose(found[spec.name], head.numpy(), atol=1e-3 * float(head.abs().max()))
    again = load_network(str(folder))
    for key, value in network.state_dict().items():
        assert torch.equal(again.state_dict()[key], value), key


def test_a_head_reads_the_feature_it_names(tmp_path, brief):
    """The paper's raw coarse map, or the widest one of its stride."""
    changed("edgemap-nano").save(tmp_path / "best.pt", {})
    manifest = read_manifest(export_backbone(str(tmp_path / "best.pt"), tmp_path / "head", feature="head"))
    (feature,) = manifest.detector.features
    assert manifest.odometry["paper"].feature == feature.name == "head_stride32"
    assert (feature.stride, feature.shape) == (32, (1, 23, 13, 13))
    wide = trained_backbone(str(tmp_path / "best.pt"), "stride32").manifest
    assert wide.detector.features[0].shape == (1, 256, 13, 13)
    with pytest.raises(ExportError, match="no tensor 'neck'"):
        export_backbone(str(tmp_path / "best.pt"), tmp_path / "x", feature="neck")
    with pytest.raises(ExportError, match="this file is fixed"):
        export_backbone(str(tmp_path / "best.pt"), tmp_path / "x", size=(320, 320))


def test_graphs_that_cannot_be_trained_are_refused(start):
    model = start.graph.model()
    odd = onnx.ModelProto()
    odd.CopyFrom(model)
    next(node for node in odd.graph.node if node.op_type == "HardSwish").op_type = "Elu"
    with pytest.raises(ExportError, match=r"operator Elu .*cannot be trained"):
        TorchNetwork(odd, start.manifest)
    odd.CopyFrom(model)
    del odd.graph.initializer[:]
    with pytest.raises(ExportError, match="weights are not stored"):
        TorchNetwork(odd, start.manifest)
