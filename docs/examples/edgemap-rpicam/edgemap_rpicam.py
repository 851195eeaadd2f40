"""`--camera rpicam[:NUMBER]`: a Raspberry Pi's CSI camera, through the program `rpicam-vid` of Raspberry Pi OS.

The program writes JPEG pictures one after the other to its standard output; this reads them, stamped as they arrive.
"""

import re
import select
import subprocess
import time

import cv2
import numpy as np

from edgemap.geometry.camera.intrinsics import Intrinsics
from edgemap.runtime.frames.camera import CameraOptions, Driver
from edgemap.runtime.frames.errors import CameraError

WIDTH, HEIGHT, RATE_HZ = 640, 480, 30
WAIT_S = 1.0
END = b"\xff\xd9"  # of a JPEG; its data never holds these two bytes


class RpicamDevice:
    """A running `rpicam-vid`. Implements `edgemap.runtime.frames.camera.Device`."""

    def __init__(self, number: str, size: tuple[int, int]) -> None:
        self.size, self.rate_hz, self.intrinsics = size, float(RATE_HZ), None
        command = ["rpicam-vid", "--camera", number, "--timeout", "0", "--nopreview", "--codec", "mjpeg", "--flush"]
        command += ["--width", str(size[0]), "--height", str(size[1]), "--framerate", str(RATE_HZ), "--output", "-"]
        try:
            self._program = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, bufsize=0)
        except FileNotFoundError:
            raise CameraError("rpicam needs the program rpicam-vid: apt install rpicam-apps-lite") from None
        self._data = b""

    def grab(self) -> tuple[float, np.ndarray] | None:
        """The next (stamp in s, BGR picture), or None within a second. Raises CameraError where the program ended."""
        assert self._program.stdout is not None
        until_s = time.monotonic() + WAIT_S
        while END not in self._data:
            ready, _, _ = select.select([self._program.stdout], [], [], max(0.0, until_s - time.monotonic()))
            if not ready:
                return None
            part = self._program.stdout.read(1 << 16)
            if not part:
                raise CameraError(f"rpicam-vid ended with exit code {self._program.wait()}")
            self._data += part
        jpeg, _, self._data = self._data.partition(END)
        image = cv2.imdecode(np.frombuffer(jpeg + END, np.uint8), cv2.IMREAD_COLOR)
        if image is None:
            raise CameraError(f"rpicam-vid wrote a damaged picture ({len(jpeg)} bytes)")
        return time.monotonic(), np.asarray(image, dtype=np.uint8)

    def close(self) -> None:
        """End the program."""
        self._program.terminate()
        self._program.wait()


class RpicamDriver(Driver):
    """Opens one camera, again and again. It has no reset, and one that is gone ends the program: `Driver`'s own do."""

    def __init__(self, number: str, intrinsics: Intrinsics | None) -> None:
        self.name, self._number = f"rpicam:{number}", number
        self._size = (intrinsics.width, intrinsics.height) if intrinsics else (WIDTH, HEIGHT)

    def open(self) -> RpicamDevice:
        """Start the program."""
        return RpicamDevice(self._number, self._size)


def open(address: str, how: CameraOptions) -> RpicamDriver:
    """`rpicam` and `rpicam:NUMBER`: what edgemap calls for such a SPEC."""
    if address and not address.isdecimal():
        raise CameraError(f"camera 'rpicam:{address}': NUMBER must be a whole number, as `edgemap cameras` lists them")
    return RpicamDriver(address or "0", how.intrinsics)


def found() -> list[tuple[str, str]]:
    """What edgemap calls for `edgemap cameras`: (address, name) of each camera."""
    command = ["rpicam-hello", "--list-cameras"]
    try:
        text = subprocess.run(command, capture_output=True, text=True, timeout=10, check=False).stdout
    except (FileNotFoundError, subprocess.TimeoutExpired):
        return []
    return re.findall(r"^(\d+) : (\S+)", text, re.MULTILINE)
