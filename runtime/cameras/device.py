"""What a live source brings to the supervisor: a driver that opens devices, and the device itself."""

from collections.abc import Callable
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.camera.intrinsics import Intrinsics


class Picture(NamedTuple):
    """stamp_s: of the device. image: BGR, (H, W, 3). depth: (H, W) metres of its pixels, 0 where unknown; None where
    there is none."""

    stamp_s: float
    image: NDArray[np.uint8]
    depth: NDArray[np.float32] | None = None


class Device(Protocol):
    """An open camera. size: (width, height) in px. rate_hz: nominal, None where it does not say."""

    size: tuple[int, int]
    intrinsics: Intrinsics | None
    rate_hz: float | None

    def grab(self) -> tuple[float, NDArray[np.uint8]] | Picture | None:
        """The next (stamp in s, BGR picture), or `Picture`, or None for "nothing yet", within a second or so.

        May raise anything: the supervisor takes it for a fault.
        """
        ...

    def close(self) -> None:
        """Let go of the hardware."""
        ...


class Driver(Protocol):
    """Opens one camera, again and again. name: the SPEC."""

    name: str

    def open(self) -> Device:
        """Open the camera. Raises CameraError, or whatever its library raises, where that fails."""
        ...

    def reset(self) -> bool:
        """Reset the hardware, closed before; False where it has no such thing."""
        ...

    def watch(self, changed: Callable[[bool], None]) -> None:
        """Have `changed(present)` called, from any thread, when the device is plugged in (True) or removed (False)."""
        ...
