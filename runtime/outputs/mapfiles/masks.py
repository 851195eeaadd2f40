"""Zones as masks for Nav2's costmap filters: where a robot must not go, and how fast it may be."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from edgemap.geometry.errors import MapError
from edgemap.geometry.objects.edits import Zone
from edgemap.runtime.outputs.mapfiles.grid import MAXIMUM_CELLS
from edgemap.runtime.outputs.mapfiles.nav2 import write_picture

KEEP_OUT = 100  # of the mask; 0 elsewhere
MARGIN_M = 1.0  # of empty mask around the zones


def write_masks(
    path: Path,
    zones: Sequence[Zone],
    keep_out: Sequence[str] = (),
    speed_percent: Mapping[str, int] | None = None,
    resolution_m: float = 0.05,
) -> list[Path]:
    """Masks of zones by name, beside `path`: NAME.keepout.yaml and .pgm, NAME.speed.yaml and .pgm; the YAML files.

    speed_percent: of the robot's highest speed, 1 to 100, in each zone; the lowest counts where zones overlap. Pixels
    are the mask's values as they are (mode raw): 100 for keep-out with a filter of type 0, the percentage with a filter
    of type 1, base 0.0 and multiplier 1.0, whose 0 is no limit. Raises MapError for a zone that is not there.
    Source: https://docs.nav2.org/configuration/packages/map_server/configuring-costmap-filter-info-server.html and
    https://docs.nav2.org/configuration/packages/costmap-plugins/speed_filter.html
    """
    speeds = dict(speed_percent or {})
    for name in (*keep_out, *speeds):
        if not any(zone.name == name or zone.id == name for zone in zones):
            known = ", ".join(zone.name for zone in zones) or "none"
            raise MapError(f"no zone {name!r} on the map; it has {known}")
    written = []
    if keep_out:
        values = [(zone, KEEP_OUT) for zone in zones if zone.name in keep_out or zone.id in keep_out]
        written.append(_write(path, "keepout", values, resolution_m))
    if speeds:
        limits = [(zone, speeds.get(zone.name, speeds.get(zone.id, 0))) for zone in zones]
        slowest_last = sorted((pair for pair in limits if pair[1]), key=lambda pair: -pair[1])
        written.append(_write(path, "speed", slowest_last, resolution_m))
    return written


def _write(path: Path, kind: str, values: Sequence[tuple[Zone, int]], resolution_m: float) -> Path:
    corners = np.array([corner for zone, _ in values for corner in zone.corners_m])
    low = np.floor((corners.min(axis=0) - MARGIN_M) / resolution_m) * resolution_m
    columns, rows = np.ceil((corners.max(axis=0) + MARGIN_M - low) / resolution_m).astype(int).tolist()
    if rows * columns > MAXIMUM_CELLS:
        raise MapError(f"{columns} x {rows} cells of {resolution_m:g} m: more than {MAXIMUM_CELLS}")
    mask: NDArray[np.uint8] = np.zeros((rows, columns), np.uint8)
    for zone, value in values:
        # fillPoly counts from the middle of a pixel.
        places = np.rint((np.array(zone.corners_m) - low) / resolution_m - 0.5).astype(np.int32)
        cv2.fillPoly(mask, [places], value)
    described = path.with_suffix(f".{kind}.yaml")
    write_picture(described, mask, "raw", resolution_m, low)
    return described
