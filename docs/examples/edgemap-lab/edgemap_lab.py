"""A camera (`--camera lab:COUNT`), a sink (`--sink lab:FILE`) and a command (`edgemap lab FILE`)."""

from pathlib import Path

import numpy as np

from edgemap.geometry.camera.intrinsics import Intrinsics
from edgemap.geometry.camera.mount import Mount
from edgemap.runtime.frames.camera import Camera, CameraInfo
from edgemap.runtime.step.sinks import Sink


class Noise(Camera):
    """COUNT pictures of noise, 10 a second."""

    @classmethod
    def open(cls, address, how):
        lens, mount = Intrinsics(320, 240, 300.0, 300.0, 159.5, 119.5), Mount.from_degrees(0.6, 10.0)
        return cls(CameraInfo(f"lab:{address}", (320, 240), lens, mount, frame_count=int(address)))

    @staticmethod
    def found():
        return [("12", "12 pictures of noise")]

    def read(self):
        if (index := self._delivered) == self.info.frame_count:
            return None
        picture = np.random.default_rng(index).integers(0, 255, (240, 320, 3), np.uint8)
        return self.frame(picture, index / 10.0, self.info.name)


class Poses(Sink):
    """A line `stamp x y yaw` for each frame."""

    def __init__(self, path):
        self.name, self.file = "poses", path.open("w")

    @classmethod
    def open(cls, address, run):
        return cls(Path(address) if address else run.folder / "poses.txt")

    def write(self, result, objects):
        print(result.frame.stamp_s, *result.pose_map_base.vector(), file=self.file, flush=True)

    def close(self):
        self.file.close()


def command(file: Path, /) -> None:
    """Print the distance of the last pose in a file from the first."""
    rows = np.loadtxt(file, ndmin=2)
    print(f"{len(rows)} poses, {np.linalg.norm(rows[-1, 1:3] - rows[0, 1:3]):.2f} m")
