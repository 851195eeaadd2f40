"""Training in several processes at once (`torchrun`): the rank of this one, and values that all must share."""

import os
from typing import Any

import torch
from torch import Tensor, distributed, nn
from torch.nn.parallel import DistributedDataParallel

from edgemap.export.errors import ExportError


class Ranks:
    """The processes of one training. rank: this one's number; count: how many; alone unless `torchrun` started them.

    device: what it computes on; each process of `cuda` has a GPU of its own. Raises ExportError where there is none.
    """

    def __init__(self, device: str = "cpu") -> None:
        self.rank, self.count = int(os.environ.get("RANK", "0")), int(os.environ.get("WORLD_SIZE", "1"))
        if device == "cuda":
            if not torch.cuda.is_available():
                raise ExportError("--device cuda: torch finds no GPU here")
            torch.cuda.set_device(int(os.environ.get("LOCAL_RANK", "0")))
        self.device = torch.device(device)
        if self.count > 1 and not distributed.is_initialized():
            distributed.init_process_group("gloo" if device == "cpu" else "nccl")

    @property
    def first(self) -> bool:
        """Whether this process writes files and prints."""
        return self.rank == 0

    def wrap(self, module: nn.Module) -> nn.Module:
        """The module whose gradients are means over all processes."""
        return DistributedDataParallel(module) if self.count > 1 else module

    def mean(self, value: Tensor) -> Tensor:
        """The mean of a tensor without gradient over all processes."""
        if self.count == 1:
            return value
        total = value.detach().clone()
        distributed.all_reduce(total)
        return total / self.count

    def broadcast(self, value: Any) -> Any:
        """The first process's value, on all processes."""
        if self.count == 1:
            return value
        box = [value]
        distributed.broadcast_object_list(box)
        return box[0]

    def close(self) -> None:
        """Leave the group."""
        if self.count > 1 and distributed.is_initialized():
            distributed.destroy_process_group()
