"""Local correlation of two feature maps: how alike each cell is to the cells around it in the previous picture."""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn import functional


def correlate(now: Tensor, before: Tensor, rows: int, columns: int) -> Tensor:
    """Dot products over a window of +-rows, +-columns: (B, C, H, W) twice to (B, H, W, (2 rows + 1)(2 columns + 1)).

    One matrix product per row shift of which the diagonals are read off by padding and reshaping: 77 slices and
    products instead took three times as long in onnxruntime. The window runs over rows first, then columns.
    """
    batch, _, height, width = now.shape
    reach = width + 2 * columns
    queries = now.permute(0, 2, 3, 1)
    keys = functional.pad(before, (columns, columns, rows, rows)).permute(0, 2, 1, 3)
    found = []
    for shift in range(2 * rows + 1):
        products = torch.matmul(queries, keys[:, shift : shift + height])  # (B, H, W, reach)
        skewed = functional.pad(products.reshape(batch, height, width * reach), (0, width))
        found.append(skewed.reshape(batch, height, width, reach + 1)[..., : 2 * columns + 1])
    return torch.cat(found, dim=-1)


def offsets(rows: int, columns: int) -> Tensor:
    """Displacements (right, down) of the window's cells, in cells, (2, (2 rows + 1)(2 columns + 1))."""
    down, right = torch.meshgrid(torch.arange(-rows, rows + 1.0), torch.arange(-columns, columns + 1.0), indexing="ij")
    return torch.stack([right.flatten(), down.flatten()])
