"""A compact video of pictures: VP9 in MP4, which every OpenCV decodes, frame for frame, to the same pixels."""

from collections.abc import Iterable
from fractions import Fraction
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from edgemap.runtime.frames.library_names import library_path
from edgemap.simulation.errors import require

QUALITY_CRF = 32  # VP9's constant quality: some 6 kB a picture of 640x480 that hardly shows it


def write_video(path: Path, pictures: Iterable[NDArray[np.uint8]], rate_hz: float) -> None:
    """Encode BGR pictures (H, W, 3) of one size, sides even; one thread, so that the bytes depend on them alone.

    Raises MissingExtraError where PyAV is absent.
    """
    av = require("av")
    with av.open(library_path(path), "w", format="mp4") as container:
        stream = container.add_stream("libvpx-vp9", rate=Fraction(rate_hz).limit_denominator(1000))
        stream.pix_fmt, stream.options = "yuv420p", {"crf": str(QUALITY_CRF), "b": "0", "cpu-used": "2"}
        stream.thread_count = 1
        for index, picture in enumerate(pictures):
            if index == 0:
                stream.height, stream.width = picture.shape[:2]
            container.mux(stream.encode(av.VideoFrame.from_ndarray(picture, format="bgr24")))
        container.mux(stream.encode())
