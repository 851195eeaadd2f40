"""The paper's head against an independent step in numpy, its size, and its checkpoints."""

import numpy as np
import pytest
import torch
from scipy.ndimage import correlate

from edgemap.export.odometry.checkpoint import HeadCheckpoint, load_head, save_head
from edgemap.export.odometry.paper import PARAMETER_LIMIT, PaperHead, random_head


def sigmoid(x):
    return 1.0 / (1.0 + np.exp(-x))


def leaky(x):
    return np.where(x > 0, x, 0.1 * x)


def numpy_cell(weight, bias, x, h, c):
    """One ConvLSTM step on (C, H, W) arrays: correlation with zero borders, gates in the order i, f, o, g."""
    stacked = np.concatenate([x, h])
    gates = [
        sum(correlate(plane, kernel, mode="constant") for plane, kernel in zip(stacked, kernels, strict=True))
        for kernels in weight
    ]
    i, f, o, g = np.split(np.stack(gates) + bias[:, None, None], 4)
    c = sigmoid(f) * c + sigmoid(i) * leaky(g)
    return sigmoid(o) * leaky(c), c


def test_head_is_two_cells_then_two_dense_layers():
    rng = np.random.default_rng(1)
    head = PaperHead((1, 3, 4, 5), hidden=(2, 3), dense=6).double()
    head.feature_mean += 0.5
    head.feature_std *= 2.0
    values = {name: tensor.numpy() for name, tensor in head.state_dict().items()}
    feature = rng.standard_normal((3, 4, 5))
    states = [rng.standard_normal(shape[1:]) for shape in head.state_shapes.values()]
    with torch.no_grad():
        motion, *new = head(*(torch.from_numpy(part)[None] for part in (feature, *states)))
    x, expected = (feature - 0.5) / 2.0, []
    for layer in range(2):
        gates = f"cells.{layer}.gates"
        x, c = numpy_cell(values[f"{gates}.weight"], values[f"{gates}.bias"], x, *states[2 * layer : 2 * layer + 2])
        expected += [x, c]
    dense = leaky(values["dense.weight"] @ x.reshape(-1) + values["dense.bias"])
    out = (values["out.weight"] @ dense + values["out.bias"]) * [0.02, 0.01, 0.04]
    np.testing.assert_allclose(motion[0].numpy(), out, atol=1e-9)
    for ours, theirs in zip(new, expected, strict=True):
        np.testing.assert_allclose(ours[0].numpy(), theirs, atol=1e-12)


@pytest.mark.parametrize("shape", [(1, 255, 13, 13), (1, 512, 13, 13), (1, 255, 10, 10), (1, 255, 19, 19)])
def test_parameters_stay_within_the_papers(shape):
    head = random_head(shape)
    assert sum(p.numel() for p in head.parameters() if p.requires_grad) <= PARAMETER_LIMIT == 2_509_555


def test_checkpoint_comes_back_whole(tmp_path):
    head = random_head((1, 8, 6, 6))
    head.feature_mean += 0.25
    sigma = (0.01, 0.02, 0.03)
    saved = HeadCheckpoint(head, "yolov3-tiny", "neck", sigma=sigma, measured={"n": 3})
    save_head(saved, tmp_path / "best.pt")
    back = load_head(tmp_path / "best.pt")
    assert (back.backbone, back.feature, back.trained, back.sigma) == ("yolov3-tiny", "neck", True, sigma)
    assert back.measured == {"n": 3}
    for name, tensor in head.state_dict().items():
        tensor_back = back.head.state_dict()[name]
        assert (tensor_back - tensor).abs().max() <= tensor.abs().max() / 250.0, name  # 8 bits
