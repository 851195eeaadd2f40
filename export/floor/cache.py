"""On-disk cache of the frozen network's features of augmented pictures, with the floor head's targets."""

import hashlib
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from edgemap.export.floor.features import Features
from edgemap.export.floor.head import FINE, STRIDES
from edgemap.export.floor.pictures import Pair, load, targets, varied

FORMAT = "edgemap.floor.views/4"
STRIDE = STRIDES[1] // FINE
FULL = 255  # of a share in 8 bits
Records = NDArray[np.void]


def cached_views(features: Features, pairs: Sequence[Pair], views: int, folder: Path) -> Records:
    """Augmented views of each labelled picture, (len(pairs) * views,), memory-mapped; missing ones are computed. s0 to
    s3: the features (C, H, W) float16, finest first. truth (2, H, W), known (H, W): shares of cells in 255ths.
    computed: (H32,), rows of the coarsest feature that are done.

    A view depends only on its number and its picture's, so existing views stay where more are requested. Raises
    ExportError, CameraError or OSError.
    """
    about = [FORMAT, features.key, *(f"{path} {path.stat().st_size} {path.stat().st_mtime_ns}" for path, _ in pairs)]
    path = folder / f"{hashlib.sha256(repr(about).encode()).hexdigest()[:16]}.views"
    folder.mkdir(parents=True, exist_ok=True)
    shape = features.taps[0].height, features.taps[0].width
    kind = np.dtype(
        [(f"s{level}", "<f2", (tap.channels, tap.height, tap.width)) for level, tap in enumerate(features.taps)]
        + [("truth", "u1", (2, *shape)), ("known", "u1", shape), ("computed", "u1", (features.taps[-1].height,))]
    )
    count = len(pairs) * views
    done = min(path.stat().st_size // kind.itemsize, count) if path.is_file() else 0
    with path.open("r+b" if done else "wb") as file:
        file.seek(done * kind.itemsize)
        for number in tqdm(range(done, count), unit=" views", disable=None if done < count else True):
            record = np.zeros(1, kind)
            image, shares = varied(*load(pairs[number % len(pairs)]), np.random.default_rng([7, number]))
            maps, placement, record["computed"] = features(image)
            truth, labelled = targets(shares, placement, STRIDE, shape)
            for level, one in enumerate(maps):
                record[f"s{level}"] = one
            record["truth"], record["known"] = np.rint(truth * FULL), np.rint(labelled * FULL)
            file.write(record.tobytes())
    return np.memmap(path, kind, "r", shape=(count,))
