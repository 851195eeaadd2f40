"""Every reader of a model: a valid file with something wrong in it is read, or refused in one line."""

import json
from functools import partial
from io import BytesIO
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from support import painted
from support.mutations import MUTATED, mutated_bytes, mutated_json, mutated_rows, mutated_tree, refused_or
from support.refusal import refused

torch = pytest.importorskip("torch")

from support.darknet_file import save_weights  # noqa: E402

from edgemap.export.adopt import load_onnx  # noqa: E402
from edgemap.export.darknet import Darknet  # noqa: E402
from edgemap.export.darknet_weights import load_weights, random_weights  # noqa: E402
from edgemap.export.detector.network import FORMAT, load_network  # noqa: E402
from edgemap.export.errors import ExportError  # noqa: E402
from edgemap.export.odometry.checkpoint import HeadCheckpoint, load_head, save_head  # noqa: E402
from edgemap.export.odometry.paper import PaperHead  # noqa: E402
from edgemap.runtime.network.bundle import load_bundle  # noqa: E402
from edgemap.runtime.network.manifest_file import MANIFEST_NAME, read_manifest, sha256_file  # noqa: E402

LAST = "[maxpool]\nsize=2\nstride=1\n"
MORE = "[upsample]\nstride=2\n\n[avgpool]\n\n[route]\nlayers=4\n\n"  # kinds of layers that the small network lacks


@pytest.fixture(scope="module")
def cfg(small_files) -> str:
    """A Darknet network with every kind of layer."""
    return small_files[0].read_text().replace(LAST, MORE + LAST)


@pytest.fixture(scope="module")
def tiny(tmp_path_factory) -> tuple[dict[str, Any], bytes]:
    """Manifest and ONNX file of a valid bundle."""
    folder = painted.write_painted(tmp_path_factory.mktemp("tiny"), [("chair", 40.0, 30.0, 20.0, 24.0, 0.9)])
    return json.loads((folder / MANIFEST_NAME).read_text()), (folder / "backbone.onnx").read_bytes()


@MUTATED
@given(data=st.data())
def test_a_damaged_manifest(tiny, tmp_path, data):
    (tmp_path / MANIFEST_NAME).write_bytes(data.draw(mutated_json(tiny[0])))
    manifest = refused_or(read_manifest, tmp_path)
    assert manifest is None or all(len(value) == 64 for value in manifest.sha256.values())


@MUTATED
@given(data=st.data())
def test_a_damaged_network_in_a_bundle_and_to_adopt(tiny, tmp_path, data):
    (tmp_path / "backbone.onnx").write_bytes(data.draw(mutated_bytes(tiny[1])))
    sums = {"sha256": {"backbone.onnx": sha256_file(tmp_path / "backbone.onnx")}}
    (tmp_path / MANIFEST_NAME).write_text(json.dumps(tiny[0] | sums))
    refused_or(lambda: load_bundle(tmp_path))
    refused_or(load_onnx, tmp_path / "backbone.onnx")


@MUTATED
@given(data=st.data())
def test_a_damaged_darknet_network(cfg, tmp_path, data):
    path = tmp_path / "a.cfg"
    path.write_bytes(data.draw(mutated_rows(cfg)))
    refused_or(Darknet, path)
    network = Darknet(cfg)
    random_weights(network)
    save_weights(network, tmp_path / "a.weights")
    weights = (tmp_path / "a.weights").read_bytes()
    head, rest = weights[:20], weights[20:]
    damaged = data.draw(mutated_bytes(head)) + rest if data.draw(st.booleans()) else data.draw(mutated_bytes(weights))
    (tmp_path / "a.weights").write_bytes(damaged)
    refused_or(load_weights, network, tmp_path / "a.weights")


def tensors(value: Any, draw: Any) -> Any:
    try:
        made = torch.tensor(value, dtype=torch.float32)
    except (ValueError, TypeError, RuntimeError, OverflowError):
        return value
    how = draw(st.sampled_from(("dense",) * 8 + ("sparse", "expanded")))
    return made.to_sparse() if how == "sparse" else made.expand(2, *made.shape) if how == "expanded" else made


@pytest.fixture(scope="module")
def head(tmp_path_factory) -> tuple[bytes, dict[str, Any]]:
    """A checkpoint's bytes, and its document as plain values."""
    path = tmp_path_factory.mktemp("head") / "head.pt"
    save_head(HeadCheckpoint(PaperHead((1, 2, 3, 3), (2,), 4), "tiny", "head"), path)
    document = torch.load(path, weights_only=True)
    document["state_dict"] = {name: tensor.tolist() for name, tensor in document["state_dict"].items()}
    return path.read_bytes(), json.loads(json.dumps(document))


@MUTATED
@given(data=st.data())
def test_a_damaged_odometry_checkpoint(head, tmp_path, data):
    if data.draw(st.booleans()):
        (tmp_path / "a.pt").write_bytes(data.draw(mutated_bytes(head[0])))
    else:
        document = data.draw(mutated_tree(head[1]))
        if isinstance(held := document.get("state_dict"), dict):
            document["state_dict"] = {name: tensors(value, data.draw) for name, value in held.items()}
        torch.save(document, tmp_path / "a.pt")
    refused_or(load_head, tmp_path / "a.pt")


@MUTATED
@given(data=st.data())
def test_a_damaged_detector_checkpoint(tiny, tmp_path, data):
    manifest, model = tiny
    graph = data.draw(mutated_bytes(model)) if data.draw(st.booleans()) else model
    text = data.draw(mutated_json(manifest | {"sha256": {}})).decode(errors="replace")
    held: Any = data.draw(mutated_tree({"manifest": text, "format": FORMAT}))
    held["graph"] = torch.frombuffer(bytearray(graph or b"x"), dtype=torch.uint8)
    stream = BytesIO()
    torch.save(held, stream)
    packed = stream.getvalue()
    (tmp_path / "a.pt").write_bytes(data.draw(mutated_bytes(packed)) if data.draw(st.booleans()) else packed)
    refused_or(load_network, str(tmp_path / "a.pt"))


refusal = partial(refused, ExportError)


def test_a_pickle_with_code_in_it_runs_nothing(tmp_path):
    class Evil:
        def __reduce__(self):
            return (open, (str(tmp_path / "ran"), "w"))

    torch.save({"format": "edgemap.head/1", "state_dict": Evil()}, tmp_path / "a.pt")
    for read in (load_head, lambda path: load_network(str(path))):
        assert "not a torch checkpoint" in refusal(read, tmp_path / "a.pt")
    (tmp_path / "a.pt").write_bytes(b"cos\nsystem\n(S'true'\ntR.")
    assert "not a torch checkpoint" in refusal(load_head, tmp_path / "a.pt")
    assert not (tmp_path / "ran").exists()


def test_a_checkpoint_that_lies_about_its_size_takes_no_memory(tmp_path, head):
    (tmp_path / "a.pt").write_bytes(head[0])
    document = torch.load(tmp_path / "a.pt", weights_only=True)
    shape, weights = {"shape": [1, 4096, 4096, 4096]}, {"state_dict": {"a": torch.zeros(1).expand(1 << 40)}}
    for changes, words in ((shape, "weights do not fit"), (weights, "no dense tensor")):
        torch.save(document | changes, tmp_path / "a.pt")
        assert words in refusal(load_head, tmp_path / "a.pt")
    document["state_dict"]["out.bias"][0] = float("inf")
    torch.save(document, tmp_path / "a.pt")
    assert "not finite" in refusal(load_head, tmp_path / "a.pt")
