"""`grid.npz`: the occupancy grid of a map.json, written atomically and read with every size checked first."""

import io
import os
import zipfile
import zlib
from contextlib import suppress
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from numpy.lib import format as npy

from edgemap.geometry.errors import MapError
from edgemap.geometry.grid.canvas import LONGEST
from edgemap.geometry.grid.occupancy_grid import OccupancyGrid
from edgemap.runtime.frames.disk import write_atomically
from edgemap.runtime.frames.reading import Name, decode_json, one_line, print_message, read_bytes

# Type and dimensions of each array.
MEMBERS = {"log_odds": ("|i1", 2), "origin_m": ("<f8", 1), "resolution_m": ("<f8", 0), "thresholds": ("<f8", 1)}


class _Named(msgspec.Struct):
    grid: Name | None = None
    grid_sum: int | None = None


def grid_name(map_path: Path) -> str:
    """The grid's file of a map: grid.npz, or NAME.grid.npz of a map that is not called map.json."""
    return "grid.npz" if map_path.name == "map.json" else f"{map_path.stem}.grid.npz"


def grid_before(grid_path: Path) -> Path:
    """The grid before this one, as long as the map.json that it belongs to is not replaced."""
    return grid_path.with_suffix(".before.npz")


def grid_sum(grid: OccupancyGrid) -> int:
    """Checksum of a grid, by which a map.json knows the one that it was saved with."""
    place = np.array([grid.x_m, grid.y_m, grid.cell_m])
    return zlib.crc32(grid.log_odds.tobytes(), zlib.crc32(place.tobytes()))


def save_grid(path: Path, grid: OccupancyGrid) -> None:
    """Write the grid atomically; the one before stays for the map.json yet to be replaced. Raises DiskError."""
    with suppress(OSError):  # a file system without hard links
        grid_before(path).unlink(missing_ok=True)
        os.link(path, grid_before(path))
    write_atomically(path, grid_bytes(grid))


def grid_bytes(grid: OccupancyGrid) -> bytes:
    """The content of a grid's file."""
    data = io.BytesIO()
    np.savez_compressed(
        data,
        log_odds=grid.log_odds,
        origin_m=np.array([grid.x_m, grid.y_m]),
        resolution_m=np.array(grid.cell_m),
        thresholds=np.array([grid.free_below, grid.occupied_above]),
    )
    return data.getvalue()


def load_grid(path: Path) -> OccupancyGrid | None:
    """The grid that a map.json, or the one of a run folder, names beside it; None where it names none, and with a
    message where that file is not there: a map.json may be copied alone.

    Raises MapError in one line where the file is not a grid, or larger than 8192 x 8192 cells.
    """
    path = path / "map.json" if path.is_dir() else path
    named = decode_json(read_bytes(path, MapError), _Named, f"{path}: damaged map", MapError)
    if (name := named.grid) is None:
        return None
    if name != Path(name).name or name in (".", "..") or "\\" in name:
        raise MapError(f"{path}: damaged map: grid {one_line(name, 60)!r} is no file beside it")
    if not path.with_name(name).exists():
        print_message(f"({path}: {name} is not beside it, so the map loads without its floor)")
        return None
    path = path.with_name(name)
    grid = read_grid(read_bytes(path, MapError), str(path))
    if named.grid_sum not in (None, grid_sum(grid)) and grid_before(path).is_file():  # cut off between the two files
        before = read_grid(read_bytes(grid_before(path), MapError), str(grid_before(path)))
        return before if grid_sum(before) == named.grid_sum else grid
    return grid


def read_grid(data: bytes, source: str) -> OccupancyGrid:
    """Parses the bytes of a grid file as `load_grid` does. source: for messages."""
    where = f"{source}: no grid"
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            arrays = [_member(archive, name, where) for name in MEMBERS]
    except MapError:
        raise
    except Exception as why:  # zipfile and numpy raise ten kinds at damaged bytes
        raise MapError(f"{where} ({one_line(why, 100)})") from None
    layout = [(array.dtype.str, array.ndim) for array in arrays]
    cells, origin, resolution, thresholds = arrays
    if layout != list(MEMBERS.values()) or len(origin) != 2 or len(thresholds) != 2 or not cells.size:
        raise MapError(f"{where}: arrays of types and dimensions {layout}")
    if max(cells.shape) > LONGEST:
        raise MapError(f"{where}: {cells.shape[1]} x {cells.shape[0]} cells, at most {LONGEST} a side")
    cell_m, (low, high) = float(resolution), thresholds.tolist()
    if not (0.005 <= cell_m <= 10.0 and np.abs(origin).max() <= 1e6 and -20.0 < low < 0.0 < high < 20.0):
        raise MapError(f"{where}: cells of {cell_m:g} m from {origin.tolist()} m, thresholds {low:g} and {high:g}")
    return OccupancyGrid(cells, float(origin[0]), float(origin[1]), cell_m, low, high)


def _member(archive: zipfile.ZipFile, name: str, where: str) -> np.ndarray[Any, Any]:
    """One array, whose size in the file is checked before it is unpacked."""
    info, most = archive.getinfo(f"{name}.npy"), LONGEST * LONGEST + 1024  # with a header
    if info.file_size > most:
        raise MapError(f"{where}: {name} of {info.file_size:,} bytes, at most {most:,} are read")
    return npy.read_array(io.BytesIO(archive.read(info)), allow_pickle=False)
