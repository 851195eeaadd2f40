"""The Darknet reader: counts by hand, the layer rules by independent arithmetic, and every way a file can be wrong."""

from functools import partial

import cv2
import numpy as np
import pytest
import torch
from support.refusal import refused

from edgemap.export.darknet import Darknet
from edgemap.export.darknet_cfg import yolov3, yolov3_tiny
from edgemap.export.darknet_weights import load_weights, value_count
from edgemap.export.errors import ExportError

SMALL_VALUES = 124 + 296 + 176 + 63  # see conftest.py


refusal = partial(refused, ExportError)


def unfilled(cfg, **options):
    """The network without values for its weights, which take seconds to draw."""
    with torch.device("meta"):
        return Darknet(cfg, **options)


def test_values_shapes_and_anchors_of_the_public_networks():
    assert value_count(unfilled(yolov3())) == 62_001_757
    assert value_count(unfilled(yolov3_tiny())) == 8_858_734
    network = unfilled(yolov3())
    assert len(network.shapes) == 107
    assert [head.shape for head in network.heads] == [(255, 13, 13), (255, 26, 26), (255, 52, 52)]
    assert [head.layer for head in network.heads] == [81, 93, 105]
    assert network.heads[0].anchors == ((116, 90), (156, 198), (373, 326))
    assert network.shapes[network.feature_layer("neck")] == (512, 13, 13)
    assert network.feature_layer("stride8") == 36


@pytest.mark.parametrize(("name", "text"), [("yolov3", yolov3), ("yolov3-tiny", yolov3_tiny)])
def test_generated_plans_equal_the_published_ones(shared_data, name, text):
    published = unfilled(shared_data / "weights" / f"{name}.cfg", size=(416, 416))
    ours = unfilled(text())
    assert [str(layer) for layer in ours.layers] == [str(layer) for layer in published.layers]
    assert [layer.sources for layer in ours.layers] == [layer.sources for layer in published.layers]
    assert ours.shapes == published.shapes
    assert ours.heads == published.heads


def test_a_network_with_groups_dropout_and_shortcuts(shared_data):
    network = Darknet(shared_data / "weights" / "yolo-fastest-1.1-xl.cfg")
    assert value_count(network) == 923_486
    load_weights(network, shared_data / "weights" / "yolo-fastest-1.1-xl.weights")
    assert [head.shape for head in network.heads] == [(255, 10, 10), (255, 20, 20)]


def test_every_value_of_the_file_lands_in_its_place(tmp_path, small_cfg):
    network = Darknet(small_cfg)
    header = np.array([0, 2, 5], "<i4").tobytes() + np.array([1 << 40], "<u8").tobytes()
    (tmp_path / "w").write_bytes(header + np.arange(SMALL_VALUES, dtype="<f4").tobytes())
    assert load_weights(network, tmp_path / "w") == 1 << 40
    values = network.state_dict()
    # Darknet: biases, scales, means, variances, then weights (filters, channels, rows, columns)
    assert values["layers.0.module.norm.bias"].tolist() == [0, 1, 2, 3]
    assert values["layers.0.module.norm.weight"].tolist() == [4, 5, 6, 7]
    assert values["layers.0.module.norm.running_mean"].tolist() == [8, 9, 10, 11]
    assert values["layers.0.module.norm.running_var"].tolist() == [12, 13, 14, 15]
    assert values["layers.0.module.conv.weight"][0, 0].tolist() == [[16, 17, 18], [19, 20, 21], [22, 23, 24]]
    assert values["layers.0.module.conv.weight"][3, 2, 2, 2].item() == 123
    assert values["layers.2.module.conv.bias"].tolist() == list(range(124, 132))
    assert values["layers.6.module.conv.weight"][6, 7].item() == SMALL_VALUES - 1


@pytest.mark.parametrize(("change", "words"), [(-4, "found 658"), (-1, "found 658 and 3 bytes more"), (4, "found 660")])
def test_short_and_long_files_are_refused_with_both_counts(small_cfg, small_weights, change, words):
    data = small_weights.read_bytes()
    small_weights.write_bytes(data[:change] if change < 0 else data + bytes(change))
    text = refusal(load_weights, Darknet(small_cfg), small_weights)
    assert f"too {'short' if change < 0 else 'long'}" in text
    assert "expected 659 float32 values" in text
    assert words in text


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("[shortcut]", "[gru]", "small.cfg:33: [gru] is not a layer"),
        ("filters=7", "filters=9", "needs 7 filters before it (1 anchors x (2 classes + 5)), found 9"),
        ("filters=4", "filters=four", "small.cfg:8: filters=four is not a whole number"),
        ("filters=4", "filters=-4", "filters=-4, expected 1 or more"),
        ("filters=4\n", "", "small.cfg:6: [convolutional] lacks filters="),
        ("from=-2", "from=-9", "this is layer 4, sources are 0 to 3"),
        ("from=-2", "from=0", "adds layer 0 of shape (4, 16, 16) to shape (8, 4, 4)"),
        ("groups=4", "groups=3", "groups=3 does not divide 8 channels"),
        ("activation=mish", "activation=gelu", "activation=gelu is not one of"),
        ("mask=1", "mask=2", "points outside of 2 anchors"),
        ("anchors=4,5, 10,12", "anchors=4,5,10", "holds 3 numbers"),
        ("[yolo]", "[maxpool]", "has no [yolo] layer"),
        ("width=32\n", "", "lacks width="),
        ("[net]", "[convolutional]", "does not start with [net]"),
        ("stride=2\npad=1\nactivation=leaky", "stride=2\nxnor=1\nactivation=leaky", "xnor=1 is not supported"),
        ("size=3\npad=1\ngroups", "what is this\ngroups", "neither [section] nor key=value"),
        ("size=3\n", "size=1000000000000\n", "size=1000000000000, at most 100,000"),
        ("filters=4", "filters=99999\nstride=1", "values, at most"),
        ("size=3\n", "size=99999\npad=1\n", "more than 134,217,728 weights"),
        ("width=32\nheight=32\nchannels=3", "width=99999\nheight=64\nchannels=99999", "is too large"),
        ("from=-2\n", "from=-2\nweights_type=per_feature\n", "weights_type=per_feature"),
        ("[maxpool]", "[route]\nlayers=0\ngroups=5\n[maxpool]", "group_id=0 of groups=5 does not fit"),
        ("[maxpool]", "[upsample]\nscale=2\n[maxpool]", "scale=2 is not supported"),
    ],
)
def test_a_cfg_that_is_wrong_says_where(small_cfg, old, new, words):
    text = small_cfg.read_text()
    assert old in text
    small_cfg.write_text(text.replace(old, new, 1))
    assert words in refusal(Darknet, small_cfg)


HEAD = "[convolutional]\nfilters=6\nsize=1\nactivation=linear\n[yolo]\nmask=0\nanchors=1,1\nclasses=1\n"


def test_routes_join_and_split_channels():
    net = "[net]\nwidth=4\nheight=4\nchannels=4\n[route]\nlayers=-1\n"
    assert "this is layer 0" in refusal(Darknet, net + HEAD)
    start = "[net]\nwidth=4\nheight=4\nchannels=4\n[convolutional]\nfilters=4\nsize=1\nactivation=linear\n"
    network = Darknet(start + "[route]\nlayers=-1\ngroups=2\ngroup_id=1\n[route]\nlayers=-1,0\n" + HEAD).eval()
    assert [shape[0] for shape in network.shapes] == [4, 2, 6, 6, 6]
    network.outputs = (0, 2)
    with torch.no_grad():
        first, joined = network(torch.rand(1, 4, 4, 4))
    torch.testing.assert_close(joined, torch.cat([first[:, 2:], first], dim=1))
    uneven = start + "[maxpool]\nsize=2\nstride=2\n[route]\nlayers=0,1\n" + HEAD
    assert "different sizes (0: 4x4, 1: 2x2)" in refusal(Darknet, uneven)


@pytest.mark.parametrize(
    ("size", "stride", "cells"), [(2, 1, 13), (2, 2, 13), (2, 2, 12), (5, 1, 13), (3, 2, 13), (9, 1, 7)]
)
def test_maxpool_pads_as_darknet_does(size, stride, cells):
    """Darknet's forward_maxpool_layer, written out as loops: offset -padding/2, cells outside never win."""
    rng = np.random.default_rng(size * 100 + cells)
    image = rng.standard_normal((cells, cells)).astype(np.float32) - 5.0  # all negative: zero padding would win
    padding = size - 1
    count = (cells + padding - size) // stride + 1
    expected = np.full((count, count), -np.inf, np.float32)
    for i in range(count):
        for j in range(count):
            for n in range(size):
                for m in range(size):
                    row, column = i * stride + n - padding // 2, j * stride + m - padding // 2
                    if 0 <= row < cells and 0 <= column < cells:
                        expected[i, j] = max(expected[i, j], image[row, column])
    net = f"[net]\nwidth={cells}\nheight={cells}\nchannels=1\n[maxpool]\nsize={size}\nstride={stride}\n"
    network = Darknet(net + HEAD).eval()
    assert network.shapes[0] == (1, count, count)
    network.outputs = (0,)
    (found,) = network(torch.from_numpy(image)[None, None])
    np.testing.assert_array_equal(found[0, 0].numpy(), expected)


def test_yolov3_tiny_sees_the_dog(shared_data):
    """The real weights on a real picture, decoded by hand: the strongest cell of the coarse head says dog."""
    network = Darknet(yolov3_tiny()).eval()
    load_weights(network, shared_data / "weights" / "yolov3-tiny.weights")
    picture = cv2.imread(str(shared_data / "pictures" / "dog.jpg"))
    picture = cv2.resize(picture[..., ::-1], (416, 416))
    with torch.no_grad():
        coarse, _ = network(torch.from_numpy(np.ascontiguousarray(picture.transpose(2, 0, 1)))[None].float() / 255.0)
    cells = coarse.reshape(3, 85, 169).permute(0, 2, 1).reshape(-1, 85)
    best = cells[cells[:, 4].argmax()]
    names = (shared_data / "weights" / "coco.names").read_text().split("\n")
    assert names[int(best[5:].argmax())] in ("dog", "car", "truck", "bicycle")
    assert torch.sigmoid(best[4]) > 0.6
