"""Checkpoints, cfg files and ONNX files made to break the host: one line each, before memory is taken."""

from functools import partial

import pytest
import torch
from support.refusal import refused

from edgemap.export.adopt import load_onnx
from edgemap.export.darknet import Darknet
from edgemap.export.darknet_weights import read_header
from edgemap.export.detector.network import load_network
from edgemap.export.errors import ExportError
from edgemap.export.odometry.checkpoint import HeadCheckpoint, load_head, save_head
from edgemap.export.odometry.paper import PaperHead
from edgemap.export.torch_files import read_torch

CFG = "[net]\nwidth=64\nheight=64\n[convolutional]\nfilters=8\nsize=1\nactivation=linear\n"
CFG += "[yolo]\nanchors=10,14\nclasses=3\n"


refusal = partial(refused, ExportError)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("size=1\n", "size=1000000000000\n", "size=1000000000000, at most 100,000"),
        ("filters=8", "filters=99999\nstride=1", "values, at most"),
        ("size=1\n", "size=99999\npad=1\n", "more than 134,217,728 weights"),
        ("width=64", "width=99999\nchannels=99999", "is too large"),
        ("anchors=10,14", "anchors=nan,14", "anchors=nan,14"),
        ("anchors=10,14", "anchors=-1,14", "sides must be positive"),
        ("classes=3", "classes=" + "9" * 5000, "is not a whole number"),
        ("[yolo]", "[maxpool]\n" * 3000, "more than 2,000 sections"),
        ("[yolo]", "[y\x1b[31m", "closing bracket"),
    ],
)
def test_a_cfg_that_asks_for_too_much(tmp_path, old, new, words):
    (tmp_path / "a.cfg").write_text(CFG.replace(old, new, 1))
    assert words in refusal(Darknet.from_cfg, tmp_path / "a.cfg")


def saved(path, **changes):
    save_head(HeadCheckpoint(PaperHead((1, 2, 3, 3), (2,), 4), "tiny", "head"), path)
    torch.save(torch.load(path, weights_only=True) | changes, path)
    return path


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"state_dict": [1]}, "no weights by name"),
        ({"state_dict": {"a": 1}}, "no dense tensor"),
        ({"state_dict": {"a": torch.zeros(1).expand(1 << 40)}}, "no dense tensor"),
        ({"state_dict": {"a": torch.zeros(2).to_sparse()}}, "no dense tensor"),
        ({"shape": [1, 4096, 4096, 4096]}, "weights do not fit"),
        ({"shape": [1, 2]}, "shape"),
        ({"sigma": [float("nan")] * 3}, "sigma[0]`, found nan"),
        ({"kind": "flow"}, "lacks its sizes"),
        ({"window": -1}, "window`, found -1"),
        ({"format": "x\n" * 1000}, "format"),
    ],
)
def test_a_checkpoint_that_lies(tmp_path, changes, words):
    assert words in refusal(load_head, saved(tmp_path / "head.pt", **changes))


def test_a_checkpoint_with_weights_that_are_not_finite(tmp_path):
    path = saved(tmp_path / "head.pt")
    document = torch.load(path, weights_only=True)
    document["state_dict"]["out.bias"][0] = float("inf")
    torch.save(document, path)
    assert "not finite" in refusal(load_head, path)


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


def test_onnx_files_that_are_none(tmp_path):
    for data in (b"", b"\xff" * 100, b"\x08\x07\x12\x01\xff"):
        (tmp_path / "a.onnx").write_bytes(data)
        refusal(load_onnx, tmp_path / "a.onnx")


HEAD = "[net]\nwidth=64\nheight=64\n"
YOLO = "[convolutional]\nfilters=6\n[yolo]\nmask=0\nanchors=1,2\nclasses=1\n"


@pytest.mark.parametrize(
    ("layers", "words"),
    [
        ("[convolutional]\nfilters=6\n[shortcut]\nfrom=-1\nweights_type=per_feature\n", "weights_type=per_feature"),
        ("[convolutional]\nfilters=6\n[route]\nlayers=-1\ngroups=4\n", "group_id=0 of groups=4 does not fit"),
        ("[convolutional]\nfilters=6\n[route]\nlayers=-1\ngroups=2\ngroup_id=2\n", "group_id=2 of groups=2"),
        (YOLO + "[convolutional]\nfilters=7\n[yolo]\nmask=0\nanchors=1,2\nclasses=2\n", "layers differ in classes"),
        ("[upsample]\nscale=2\n", "scale=2 is not supported"),
        ("[maxpool]\nsize=99\npadding=0\n", "size=99 does not fit into 64x64 cells"),
    ],
)
def test_layers_that_fit_nothing(layers, words):
    assert words in refusal(Darknet.from_cfg, HEAD + layers + YOLO)


def test_features_and_strides_that_a_network_has_not():
    network = Darknet.from_cfg(HEAD + YOLO)
    with pytest.raises(ExportError, match="has no feature 'tail'"):
        network.feature_layer("tail")
    odd = Darknet.from_cfg(HEAD.replace("height=64", "height=48") + "[avgpool]\n" + YOLO)
    with pytest.raises(ExportError, match="no whole stride of a 64x48 input"):
        odd.stride(0)


def test_torch_files_that_hold_no_checkpoint(tmp_path):
    with pytest.raises(ExportError, match="no such checkpoint"):
        read_torch(tmp_path / "none.pt")
    torch.save([1], tmp_path / "a.pt")
    with pytest.raises(ExportError, match="holds a list, no checkpoint"):
        read_torch(tmp_path / "a.pt")
    with pytest.raises(ExportError, match=r"cannot be read \(not a file\)"):
        read_header(tmp_path)
