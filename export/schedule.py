"""Schedule of a training budget of minutes, epochs or steps: learning rate and end."""

from __future__ import annotations

import math
from dataclasses import dataclass

WARM_UP = 0.03  # of the budget
LAST_RATE = 0.03  # of the highest


@dataclass(frozen=True)
class Schedule:
    """A budget of minutes or, where that is None, of epochs."""

    minutes: float | None
    epochs: int

    def progress(self, trained_s: float, epoch: float) -> float:
        """Share of the budget that is spent, 0..1. epoch: whole and part epochs done."""
        if self.minutes is not None:
            return min(1.0, trained_s / (60.0 * self.minutes))
        return min(1.0, epoch / self.epochs) if self.epochs else 1.0

    @staticmethod
    def rate(progress: float) -> float:
        """Factor on the learning rate: a short rise, then a cosine down."""
        if progress < WARM_UP:
            return max(0.01, progress / WARM_UP)
        fall = (progress - WARM_UP) / (1.0 - WARM_UP)
        return LAST_RATE + (1.0 - LAST_RATE) * 0.5 * (1.0 + math.cos(math.pi * fall))
