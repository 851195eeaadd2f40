"""An occupancy map for Nav2's map_server: a PGM picture and the YAML that says where it lies."""

from pathlib import Path

import numpy as np

from edgemap.runtime.disk import write_atomically
from edgemap.runtime.mapfiles.grid import FREE, OCCUPIED, UNKNOWN, Grid

# What map_saver writes: darkness is occupancy, (255 - value) / 255; unknown lies between both thresholds.
VALUES = {FREE: 254, OCCUPIED: 0, UNKNOWN: 205}
FREE_THRESH, OCCUPIED_THRESH = 0.196, 0.65


def write_nav2(path: Path, grid: Grid) -> tuple[Path, Path]:
    """Write `path` (YAML) and the picture of the same name beside it; both paths. Raises MapError.

    The picture's first row is its top: the greatest y. Its lower left corner lies at `origin` (x, y, yaw) of the map
    frame, columns run along x. Source: https://docs.nav2.org/configuration/packages/configuring-map-server.html and
    nav2_map_server's map_io.cpp (cell (x, height - y - 1) is pixel (x, y)).
    """
    picture = path.with_suffix(".pgm")
    levels = np.zeros(256, np.uint8)
    for value, level in VALUES.items():
        levels[np.uint8(value % 256)] = level
    rows, columns = grid.cells.shape
    header = f"P5\n# edgemap: {grid.resolution_m:g} m per pixel\n{columns} {rows}\n255\n"
    write_atomically(picture, header.encode() + levels[grid.cells[::-1].view(np.uint8)].tobytes())
    lines = [
        f"image: {picture.name}",
        "mode: trinary",
        f"resolution: {grid.resolution_m:.6f}",
        f"origin: [{grid.x_m:.6f}, {grid.y_m:.6f}, 0.0]",
        "negate: 0",
        f"occupied_thresh: {OCCUPIED_THRESH}",
        f"free_thresh: {FREE_THRESH}",
    ]
    write_atomically(path, "\n".join(lines) + "\n")
    return path, picture
