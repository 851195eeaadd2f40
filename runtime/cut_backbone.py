"""A backbone that computes only some rows of its input, with features as if it had computed all."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from edgemap.runtime.network import Network, Tensors


def with_padding(cut: Network, padding: Tensors, above: float = 0.0) -> Network:
    """The cut network whose outputs named in `padding`, features (1, C, H, W) of all rows, are filled up with those.

    above: share of all rows that is left out above.
    So an odometry head reads what it was trained on. Two pictures' features exist at a time: those of the frame before
    the last one are written over.
    """
    names = list(cut.outputs)
    places = [(names.index(name), [whole.copy(), whole.copy()]) for name, whole in padding.items()]

    def infer(tensors: Tensors) -> Sequence[NDArray[np.float32]]:
        outputs = list(cut.infer(tensors))
        for at, buffers in places:
            buffers.reverse()
            first = round(above * buffers[0].shape[2])
            buffers[0][:, :, first : first + outputs[at].shape[2]] = outputs[at]
            outputs[at] = buffers[0]
        return outputs

    return replace(cut, outputs=cut.outputs | {name: whole.shape for name, whole in padding.items()}, infer=infer)
