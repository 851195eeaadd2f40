"""`edgemap map merge`: several maps of one place become one."""

from math import degrees
from pathlib import Path
from typing import Annotated

import tyro

from edgemap.cli.arguments import arg
from edgemap.runtime.frames.disk import make_folder
from edgemap.runtime.frames.errors import UsageError
from edgemap.runtime.step.map_store import saved_map


def command(
    maps: Annotated[
        tyro.conf.Positional[tuple[Path, ...]],
        arg(metavar="A B...", help="map.json files or run folders of one place; the first one's frame counts."),
    ],
    *,
    out: Annotated[Path, arg(aliases=["-o"], metavar="OUT", help="map.json to write, or a folder to write it into.")],
) -> None:
    """Lay maps of one place onto each other by their objects and floors, and join them into one.

    Labels, mutual distances and walls decide; no start pose is needed, and no mirror image fits. Refuses, with the
    reason, where too few objects agree, chance explains it, or a clearly different alignment fits nearly as well.
    The first map's frame and ids stay; what only later maps have gets ids of its own. Zones and edits of all maps are
    kept, and their floors become one.
    """
    from edgemap.geometry.objects.merge import merge_all
    from edgemap.geometry.registration.alignment import AlignmentError
    from edgemap.runtime.step.grid_file import load_grid
    from edgemap.runtime.step.map_file import load_annotated_map, save_map

    if len(maps) < 2:
        raise UsageError(f"{len(maps)} map given: merging needs two or more")
    path = out if out.suffix == ".json" else out / "map.json"
    if (path.parent / "run.json").exists() and path.name == "map.json":
        raise UsageError(f"{path.parent}: holds a run, whose map would be lost: --out takes another place")
    places = {str(number): saved_map(one) for number, one in enumerate(maps)}
    loaded = {number: load_annotated_map(place) for number, place in places.items()}
    merged = merge_all(loaded, "0", {number: load_grid(place) for number, place in places.items()})
    for number, reason in merged.refused.items():
        raise AlignmentError(f"{places[number]} does not fit onto {places['0']}: {reason}")
    print(f"{places['0']}: {len(loaded['0'][0])} objects")
    for number, alignment in list(merged.alignments.items())[1:]:
        pose = alignment.pose_a_b
        rival = f"next best {alignment.rival}" if alignment.rival else "no other fits"
        print(
            f"{places[number]}: {len(loaded[number][0])} objects, {len(alignment.pairs)} of {alignment.shared} matched "
            f"({rival}) by x {pose.x_m:.2f} m, y {pose.y_m:.2f} m, yaw {degrees(pose.yaw_rad):.1f} deg; "
            f"{alignment.rms_m:.2f} m apart"
        )
    make_folder(path.parent)
    save_map(path, merged.objects, merged.annotations, merged.grid)
    print(f"map of {len(merged.objects)} objects saved in {path}")
