"""`edgemap eval odometry`: how far the robot's own motion drifts, against true poses."""

from math import degrees
from pathlib import Path
from typing import Annotated, Any

import tyro

from edgemap.cli.arguments import arg
from edgemap.cli.camera_options import MountText, read_mount
from edgemap.cli.network_options import NetworkOptions
from edgemap.cli.options import ConfigFile, Json, WithoutDepth, WithoutImu, at_least, print_json
from edgemap.runtime.frames.errors import UsageError

Repeated = tyro.conf.UseAppendAction[tuple[tuple[str, ...], ...]]
DEFAULT_DATA = (("demo",),)


def command(
    network: Annotated[NetworkOptions, arg(name="Network")],
    data: Annotated[
        Repeated,
        arg(
            aliases=["--camera"],
            metavar="demo|KIND:DIR|sim:SEED|FILE.mcap",
            help="Drives with true poses, several at once or the option again: KIND is kitti, tum, c2w, drive, "
            "euroc or locobot; sim:SEED is rendered. The demo by default.",
        ),
    ] = (),
    odometry: Annotated[
        str,
        arg(
            metavar="SPEC",
            help="As of `edgemap run`; wheel: the wheel odometry that comes with the data; window and gyro: a "
            "member of the hybrid alone.",
        ),
    ] = "hybrid",
    mount: MountText = None,
    without_wheels: Annotated[
        bool, arg(help="hybrid leaves aside the wheel odometry that comes with the data.")
    ] = False,
    without_imu: WithoutImu = False,
    without_depth: WithoutDepth = False,
    first: Annotated[
        int, arg(name="from", metavar="N", help="Start with frame N, counted from 0; it is the origin.")
    ] = 0,
    every: Annotated[int, arg(metavar="K", help="Use each K-th frame only: 2 makes 5 Hz out of 10 Hz.")] = 1,
    frames: Annotated[int | None, arg(metavar="N", help="Only the first N of those frames.")] = None,
    config: ConfigFile = None,
    segments: Annotated[
        str | None,
        arg(metavar="L,…", help="Lengths in metres over which drift is taken; 1,2,5, and 100,200,…,800 for kitti."),
    ] = None,
    plot: Annotated[
        Path | None, arg(metavar="DIR", help="Draw each trajectory with the true one into this folder.")
    ] = None,
    json: Json = False,
) -> None:
    """Compare integrated motions with the drives' true poses, from a common start.

    t_rel (percent of the way) and r_rel (degrees per metre) follow the KITTI protocol: means over all segments of a
    length, started every tenth frame. ATE: positions after the best rigid alignment. eq. 9: the paper's RMSE of
    integrated x and y, not aligned. NEES: 3 on average where the stated covariances are consistent, of single
    frames and of motions summed over 1 to 10 s. Still: what is
    estimated in frames in which the robot moves less than 0.5 mm and 0.01 degrees. The total counts every segment and
    frame of all sequences once.
    """
    from tqdm import tqdm

    from edgemap.benchmarks.odometry import ScoredDrive, Selection, score_drive, sequence_names, together
    from edgemap.cli.simulated import as_data
    from edgemap.runtime.step.config import Config, load_config
    from edgemap.runtime.step.slam import SlamOptions

    at_least(1, every=every, frames=frames)
    if first < 0:
        raise UsageError(f"--from {first}: must be 0 or more")
    tuned = load_config(config) if config else Config()
    selection = Selection(first, every, frames, _lengths(segments), not without_depth, read_mount(mount), tuned)
    how = SlamOptions(odometry, not without_wheels, not without_imu)
    specs = [spec for several in data or DEFAULT_DATA for spec in several]
    if not specs:
        raise UsageError("--data: expected at least one demo, KIND:DIR, sim:SEED or FILE.mcap")
    names = sequence_names(specs)
    if repeated := next((name for name in names if names.count(name) > 1), None):
        raise UsageError(f"--data {repeated} is given twice")
    loaded = network.load(*specs)
    needed = None if frames is None else first + (frames - 1) * every + 1
    drives: dict[str, ScoredDrive] = {}
    for name, spec in zip(names, specs, strict=True):
        with as_data(spec, needed, quiet=json) as found, tqdm(unit=" frames", desc=name, disable=json or None) as bar:
            drives[name] = score_drive(found, how, loaded, selection, bar.update)
        if plot:
            from edgemap.plots.trajectories import plot_ways

            plot_ways(plot / f"{_file_name(name)}.png", name, drives[name].true, {odometry: drives[name].estimated})
    document: dict[str, Any] = {"bundle": loaded.manifest.name, "precision": loaded.precision}
    document |= {"engine": loaded.compute.engine, "odometry": odometry} | together(drives)
    for name, spec in zip(names, specs, strict=True):
        document["sequences"][name]["data"] = spec
    if json:
        print_json(document)
        return
    print(f"{odometry} odometry, bundle {document['bundle']}")
    for name, own in document["sequences"].items():
        mount = f"camera {own['mount']['height_m']:.2f} m high, {own['mount']['pitch_deg']:.1f} deg down"
        print(f"{name}: {own['frames']} frames at {own['rate_hz']:g} Hz, {own['path_m']:.1f} m, {mount}")
        _print(own)
    if len(drives) > 1:
        total = document["total"]
        print(f"total: {len(drives)} sequences, {total['frames']} frames, {total['path_m']:.1f} m")
        _print(total)


def _lengths(text: str | None) -> tuple[float, ...] | None:
    if text is None:
        return None
    try:
        lengths = tuple(float(part) for part in text.split(","))
    except ValueError:
        lengths = ()
    if not lengths or not all(0.0 < length < float("inf") for length in lengths):
        raise UsageError(f"--segments {text!r}: expected lengths in metres above 0, L,L,…")
    return lengths


def _file_name(name: str) -> str:
    return "".join(letter if letter.isalnum() or letter in "-_." else "-" for letter in name).strip("-.") or "way"


def _print(own: dict[str, Any]) -> None:
    for key, unit, title in (("t_rel_percent", " %", "t_rel"), ("r_rel_deg_per_m", " deg/m", "r_rel")):
        figures = [
            f"{length} m {value:.{3 if value < 1 else 2}f}{unit}"
            for length, value in own[key].items()
            if value is not None
        ]
        missing = [length for length, value in own[key].items() if value is None]
        if missing and key == "t_rel_percent":
            figures.append(f"no segment of {', '.join(missing)} m fits")
        if figures:
            print(f"  {title}     {'   '.join(figures)}")
    print(f"  ATE       {own['ate_m']:.3f} m   eq. 9 {own['paper_rmse']:.3f} m, {own['paper_rmse_yaw_rad']:.4f} rad")
    nees = "–" if own["nees"] is None else f"{own['nees']:.2f}, median {own['nees_median']:.2f}"
    print(
        f"  a frame   forward {100 * own['rmse_forward_m']:.3f} cm   left {100 * own['rmse_left_m']:.3f} cm   "
        f"yaw {degrees(own['rmse_yaw_rad']):.3f} deg (RMSE)   NEES {nees}   {own['faults']} faults"
    )
    windows = [f"{length} s {value:.2f}" for length, value in own["window_nees"].items() if value is not None]
    if windows:
        print(f"  NEES of   {'   '.join(windows)}, summed over such a time (3 is consistent)")
    still = own["still"]
    if still["frames"]:
        cm, deg = still["cm_per_frame"], still["deg_per_frame"]
        print(
            f"  still     {still['frames']} frames: {cm['mean']:.4f} cm, at most {cm['max']:.4f}; "
            f"{deg['mean']:.4f} deg, at most {deg['max']:.4f}"
        )
    if fit := own.get("planar_fit"):
        drift = "" if fit["t_rel_percent"] is None else f", t_rel {fit['t_rel_percent']:.2f} %"
        off = f"{fit['mean_m']:.2f} m, {fit['mean_percent']:.2g} % of the path, at most {fit['max_m']:.2f} m{drift}"
        height = f"{fit['height_mean_m']:.2f} m, at most {fit['height_max_m']:.2f} m"
        print(f"  3 of 6    integrated, off the full poses: {off}; height left out: {height}")
    if attitude := own.get("attitude"):
        _print_attitude(attitude)
    if worst := own.get("worst"):
        print(f"  worst     {worst['sequence']}: t_rel over {worst['length_m']:g} m {worst['t_rel_percent']:.2f} %")


def _print_attitude(attitude: dict[str, Any]) -> None:
    sources = ", ".join(f"{name} {100 * share:.0f} %" for name, share in attitude["sources"].items())
    error = ""
    if attitude["pitch_rms_deg"] is not None:
        error = (
            f"   pitch {attitude['pitch_rms_deg']:.2f} deg   roll {attitude['roll_rms_deg']:.2f} deg (RMS), "
            f"at most {attitude['max_deg']:.2f}   NEES {attitude['nees']:.2f}"
        )
    print(f"  attitude  by {sources}{error}")
