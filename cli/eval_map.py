"""`edgemap eval map`: how true the map is, with true poses and with estimated ones."""

from collections.abc import Iterator
from dataclasses import replace
from math import degrees
from pathlib import Path
from typing import Annotated, Any

from edgemap.cli.arguments import arg
from edgemap.cli.groups import MappingOptions, MotionOptions
from edgemap.cli.network_options import NetworkOptions
from edgemap.cli.options import ConfigFile, Json, WithoutDepth, at_least, figure, print_json
from edgemap.runtime.frames.errors import CameraError


def command(
    motion: Annotated[MotionOptions, arg(name="Robot")],
    mapping: Annotated[MappingOptions, arg(name="Map")],
    network: Annotated[NetworkOptions, arg(name="Network")],
    data: Annotated[
        str,
        arg(
            aliases=["--camera"],
            metavar="demo|KIND:DIR|sim:SEED",
            help="A drive with poses and objects.json, or one that is rendered: 450 frames unless --frames says more.",
        ),
    ] = "demo",
    without_depth: WithoutDepth = False,
    frames: Annotated[int | None, arg(metavar="N", help="Only the first N frames.")] = None,
    config: ConfigFile = None,
    plot: Annotated[
        Path | None,
        arg(
            metavar="DIR",
            help="Draw the maps with the true objects, and how true their confidences are, into this folder.",
        ),
    ] = None,
    json: Json = False,
) -> None:
    """Compare maps with what really stands there: once with the drive's true poses, once with the odometry's.

    Where the drive brings wheels, the hybrid's map without them stands beside (`without_wheels`).
    Objects are matched by class, one to one, within 0.5 m, in the start-pose frame, without alignment. True objects
    seen in fewer than 10 frames (30 % visible, 24 px) do not count; a mapped object that is not on the floor is wrong.
    covered95 is the share of true positions inside the mapped 95 % ellipse; ANEES (1 is consistent) and the mean area
    of that ellipse are over all mapped objects with a true one of their class within 1.5 m. ECE is the mean difference
    of confidence and share of real objects. `shape` is F1 once more after alignments by the objects themselves: a map
    with a good shape and a poor F1 has its origin, heading or scale wrong. Where the drive has a floor_plan.json,
    `grid` judges free and occupied cells and seen walls, `rooms` the true rooms found (IoU of 0.5 and more, of those
    half seen) and `doors` those within 0.5 m, without alignment. `footprint`, where the truth has footprint_m: F1 of
    footprints that overlap by an IoU of 0.25, mean IoU of objects found, and the median error of the yaw of couches,
    beds, tables and refrigerators.
    """
    from edgemap.benchmarks.map_variants import plan_figures, replayed, true_objects
    from edgemap.cli.simulated import as_data
    from edgemap.evaluation.footprints import score_footprints
    from edgemap.evaluation.map_alignment import aligned_figures
    from edgemap.evaluation.objects import score_map, scored
    from edgemap.evaluation.trajectory import path_m
    from edgemap.runtime.inputs.drives import open_drive
    from edgemap.runtime.step.config import Config, load_config
    from edgemap.runtime.step.slam import SlamOptions

    at_least(1, frames=frames)
    tuned = load_config(config) if config else Config()
    motion.check()
    mapping.check()
    loaded = network.load(data)
    with as_data(data, frames, quiet=json) as spec:
        drive = open_drive(spec)
        drive = replace(drive, depth=()) if without_depth else drive
        if not drive.objects or drive.truth is None or drive.mount is None:
            raise CameraError(f"{data}: eval map needs true poses, a mount and objects.json")
        truth = true_objects(drive, frames)
        wanted = scored(truth)
        count = min(frames or len(drive.stamps_s), len(drive.stamps_s))
        poses = drive.truth.poses[:count]
        travelled_m = float(path_m(poses)[-1])
        document: dict[str, Any] = {
            "data": data,
            "bundle": loaded.manifest.name,
            "precision": loaded.precision,
            "engine": loaded.compute.engine,
            "odometry": motion.odometry,
            "wheels": drive.wheel is not None and not motion.without_wheels,
            "imu": drive.imu is not None and not motion.without_imu,
            "depth": bool(drive.depth),
            "clustering": mapping.clustering,
            "loop_closure": mapping.loop_closure,
            "frames": count,
            "path_m": round(travelled_m, 3),
            "objects_true": len(wanted),
            "mount": {"height_m": drive.mount.height_m, "pitch_deg": round(degrees(drive.mount.pitch_rad), 3)},
        }
        options = SlamOptions(
            motion.odometry,
            not motion.without_wheels,
            not motion.without_imu,
            mapping.clustering,
            mapping.loop_closure,
            confidence=mapping.confidence,
            pose_frame=motion.pose_frame,
        )
        variants = {"true": replace(options, odometry="truth", wheels=True), "estimated": options}
        if motion.odometry == "hybrid" and document["wheels"]:
            variants["without_wheels"] = replace(options, wheels=False)
        for name, slam in replayed(drive, loaded, variants, count, tuned).items():
            objects = slam.objects()
            document[name] = score_map(objects, truth) | aligned_figures(objects, truth)
            if footprint := score_footprints(objects, truth):
                document[name]["footprint"] = footprint
            document[name] |= plan_figures(objects, slam.mapper.annotations(), slam.mapper.grid.grid(), drive, count)
            if plot:
                from edgemap.plots.charts import plot_reliability
                from edgemap.runtime.outputs.map_formats.drawing import DrawnMap, draw_map

                plot_reliability(plot / f"{name}-confidence.png", document[name]["reliability"])
                places = [(item.label, item.x_m, item.y_m) for item in wanted]
                draw_map(plot / f"{name}.png", DrawnMap(objects, drive.truth.poses, truth=places))
    if json:
        print_json(document)
        return
    room = f"{count} frames, {travelled_m:.1f} m, {document['objects_true']} objects on the floor"
    print(f"{document['bundle']} on {data}: {room}")
    for name in variants:
        figures = document[name]
        poses = {"true": "true poses", "estimated": f"{motion.odometry} poses"}.get(name, "without wheels")
        for line in _lines(figures):
            print(f"  {poses:<14} {line}")
        for label, row in figures["per_class"].items():
            print(f"    {label:<14} {_line(row)}")


def _line(figures: dict[str, Any]) -> str:
    return (
        f"F1 {figure(figures['f1'])}  precision {figure(figures['precision'])}  recall {figure(figures['recall'])}  "
        f"median error {figure(figures['median_error_m'], unit=' m')}  "
        f"p90 {figure(figures['p90_error_m'], unit=' m')}  "
        f"covered95 {figure(figures['covered95'])}  ANEES {figure(figures['anees'])}  "
        f"ellipse {figure(figures['ellipse_m2'], unit=' m2')}"
    )


def _lines(figures: dict[str, Any]) -> Iterator[str]:
    """What is printed of one variant, where it has it."""
    if grid := figures.get("grid"):
        free, occupied, walls = grid["free"], grid["occupied"], grid["walls"]
        yield (
            f"floor: free cells right {figure(free['precision'])}, within 10 cm {figure(free['precision_10cm'])}, "
            f"of all {figure(free['recall'])}; occupied within 10 cm {figure(occupied['precision_10cm'])}; "
            f"walls seen {figure(walls['recall'])}"
        )
        rooms, doors = figures["rooms"], figures["doors"]
        yield (
            f"rooms: found {figure(rooms['found'])}, IoU {figure(rooms['mean_iou'])}, precision "
            f"{figure(rooms['precision'])}, kinds right {figure(rooms['kinds'])}; doors: precision "
            f"{figure(doors['precision'])}, recall {figure(doors['recall'])}"
        )
    yield f"{_line(figures)}  ECE {figure(figures['reliability']['ece'])}"
    yield (
        f"shape: F1 {figure(figures['f1_aligned'])} after the best rigid alignment, {figure(figures['f1_scaled'])} "
        f"after one that scales too; map {figure(figures['scale'])} times its true size"
    )
    if found := figures.get("footprint"):
        yield (
            f"footprints: F1 {figure(found['f1_iou25'])} at IoU 0.25, mean IoU {figure(found['mean_iou'])}; yaw error "
            f"{figure(found['yaw_error_deg'], unit=' deg')}, known for {figure(found['oriented'])} of those judged"
        )
