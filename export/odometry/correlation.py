"""Local correlation of two feature maps: how alike each cell is to the cells around it in the previous picture."""

import torch
from torch import Tensor
from torch.nn import functional

BLOCK = 13  # columns that are compared with one window of the previous picture, or as near as a divisor comes


def correlate(now: Tensor, before: Tensor, rows: int, columns: int) -> Tensor:
    """Dot products over a window of +-rows, +-columns: (B, C, H, W) twice to (B, H, W, (2 rows + 1)(2 columns + 1)).

    One matrix product for every block of columns and all row shifts, whose diagonals are read off by padding and
    reshaping: slices and products one by one take five times as long in onnxruntime. The window runs over rows first,
    then columns.
    """
    batch, channels, height, width = now.shape
    block = min((d for d in range(1, width + 1) if width % d == 0), key=lambda d: abs(d - BLOCK))
    shifts, window = 2 * rows + 1, block + 2 * columns
    queries = now.permute(0, 2, 3, 1).reshape(batch, height, width // block, block, channels)
    padded = functional.pad(before.permute(0, 2, 3, 1), (0, 0, columns, columns, rows, rows))[:, :, None]
    keys = torch.cat([padded[:, :, :, first : first + window] for first in range(0, width, block)], dim=2)
    keys = torch.cat([keys[:, shift : shift + height] for shift in range(shifts)], dim=3)
    products = torch.matmul(queries, keys.transpose(3, 4))  # (B, H, blocks, block, shifts * window)
    span = shifts * window
    skewed = functional.pad(products.flatten(3), (0, block)).unflatten(3, (block, span + 1))[..., :span]
    return skewed.reshape(batch, height, width, shifts, window)[..., : 2 * columns + 1].flatten(3)


def offsets(rows: int, columns: int) -> Tensor:
    """Displacements (right, down) of the window's cells, in cells, (2, (2 rows + 1)(2 columns + 1))."""
    down, right = torch.meshgrid(torch.arange(-rows, rows + 1.0), torch.arange(-columns, columns + 1.0), indexing="ij")
    return torch.stack([right.flatten(), down.flatten()])
