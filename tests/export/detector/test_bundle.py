"""A detector's checkpoint on its way to the robot: float16 file, bundle, the runtime's boxes."""

import numpy as np
import pytest

torch = pytest.importorskip("torch")

from edgemap.export.detector.checkpoint import DetectorCheckpoint, load_detector, save_detector  # noqa: E402
from edgemap.export.detector.classes import NAMES, nano_classes  # noqa: E402
from edgemap.export.detector.network import Nano  # noqa: E402
from edgemap.export.errors import ExportError  # noqa: E402
from edgemap.export.exporter import export_backbone  # noqa: E402
from edgemap.runtime.bundle import load_bundle  # noqa: E402
from edgemap.runtime.manifest import read_manifest  # noqa: E402


@pytest.fixture(scope="module")
def best(tmp_path_factory):
    torch.manual_seed(1)
    path = tmp_path_factory.mktemp("run") / "best.pt"
    checkpoint = DetectorCheckpoint(
        Nano(len(NAMES)), NAMES, 64, "none", "Apache-2.0", ("random weights",), {"validation": {"ap50": 0.5}}
    )
    save_detector(checkpoint, path)
    return path


@pytest.fixture(scope="module")
def bundle(best, tmp_path_factory):
    return export_backbone(str(best), tmp_path_factory.mktemp("bundle") / "nano")


def test_the_manifest_says_all_that_the_robot_needs(bundle, best):
    manifest = read_manifest(bundle)
    detector = manifest.detector
    assert (manifest.name, detector.decode, manifest.odometry) == ("edgemap-nano", "yolov3", {})
    assert (detector.input.resize, detector.input.colour, detector.input.pad) == ("letterbox_topleft", "bgr", 114)
    assert [(head.name, head.shape) for head in detector.heads] == [
        ("head_stride32", (1, 23, 2, 2)),
        ("head_stride16", (1, 23, 4, 4)),
        ("head_stride8", (1, 23, 8, 8)),
    ]
    assert detector.features == ()  # nobody reads any
    assert [entry.name for entry in detector.classes] == list(NAMES)
    assert manifest.measured["validation"] == {"ap50": 0.5}
    assert manifest.measured["weights"]["parameters"] == 1_323_125
    assert manifest.parity["backbone.onnx"].max_abs_difference <= manifest.parity["backbone.onnx"].tolerance


def test_the_bundle_computes_what_the_checkpoint_does(bundle, best):
    picture = np.random.default_rng(2).integers(0, 256, (1, 3, 64, 64)).astype(np.float32)
    found = load_bundle(bundle).backbone.run({"image": picture})
    network = load_detector(best, fold=False).network
    with torch.no_grad():
        fine, middle, coarse = network(torch.from_numpy(picture))
    for name, tensor in (("head_stride8", fine), ("head_stride16", middle), ("head_stride32", coarse)):
        np.testing.assert_allclose(found[name], tensor.numpy(), atol=1e-3 * tensor.abs().max())


def test_a_head_reads_the_feature_it_names(best, tmp_path):
    manifest = read_manifest(export_backbone(str(best), tmp_path / "with-head", feature="stride8"))
    assert manifest.odometry["paper"].feature == "feature_stride8"
    assert [(f.shape, f.stride) for f in manifest.detector.features] == [((1, 64, 8, 8), 8)]
    assert not manifest.odometry["paper"].trained
    with pytest.raises(ExportError, match="no feature 'neck'; there are head, stride32, stride8"):
        export_backbone(str(best), tmp_path / "none", feature="neck")
    with pytest.raises(ExportError, match="this file is fixed"):
        export_backbone(str(best), tmp_path / "none", size=(320, 320))


def test_damaged_checkpoints_are_refused_by_name(best, tmp_path):
    document = torch.load(best, weights_only=True)
    for change, message in (
        ({"format": "other/1"}, "expected 'edgemap.detector/1'"),
        ({"names": ["chair"]}, "weights do not fit"),
        ({"names": ["sofa"] * 18}, "sofa"),
    ):
        torch.save(document | change, tmp_path / "bad.pt")
        with pytest.raises(ExportError, match=message):
            load_detector(tmp_path / "bad.pt")
    document["state_dict"]["stem.conv.weight"][0] = float("nan")
    torch.save(document, tmp_path / "bad.pt")
    with pytest.raises(ExportError, match="not finite"):
        load_detector(tmp_path / "bad.pt")


def test_only_furniture_goes_on_the_map():
    mapped = {entry.name for entry in nano_classes() if entry.mapped}
    assert {"chair", "couch", "bed", "dining table", "refrigerator", "vase"} <= mapped
    assert not {"person", "cat", "dog", "laptop", "microwave", "tv"} & mapped
