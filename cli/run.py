"""`edgemap run`: the main job."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from edgemap.cli.arguments import arg
from edgemap.cli.budget import CpuShare, Temperature, budgeted, read_share
from edgemap.cli.fleet import Fleet, fleet_sinks
from edgemap.cli.options import (
    BundleName,
    CameraFile,
    CameraSpec,
    Confidence,
    ConfigFile,
    EngineName,
    IntrinsicsText,
    LoopClosure,
    MountText,
    OdometrySpec,
    PrecisionName,
    Threads,
    WithoutDepth,
    WithoutImu,
    WithoutWheels,
    at_least,
    choose_classes,
    find_bundle,
    lens_and_mount,
    minimum_score,
    open_described,
    typed_options,
)
from edgemap.cli.publishers import Foxglove, MqttBroker, Rerun, RerunPictures, RobotName, open_publishers
from edgemap.cli.ros2 import (
    FRAMES,
    DepthTopicName,
    ImuTopic,
    OdomTf,
    Ros2,
    Ros2BestEffort,
    Ros2Frames,
    Ros2Namespace,
    Ros2Pictures,
    WheelTopic,
    frame_names,
    ros2_sinks,
)
from edgemap.cli.saved_map import EditsFile, Forget, SavedMap, StartText, enter_saved_map, forgets, where_it_was

if TYPE_CHECKING:
    from edgemap.geometry.camera.mount import Mount
    from edgemap.geometry.objects.evaluation_row import EvaluationRow
    from edgemap.geometry.objects.map_object import MapObject
    from edgemap.runtime.cameras.protocol import Camera
    from edgemap.runtime.sinks.group import Sink
    from edgemap.runtime.slam import StepResult


def command(
    camera: CameraSpec = "demo",
    bundle: BundleName = None,
    odometry: OdometrySpec = "hybrid",
    without_wheels: WithoutWheels = False,
    without_imu: WithoutImu = False,
    without_depth: WithoutDepth = False,
    mount: MountText = None,
    intrinsics: IntrinsicsText = None,
    camera_file: CameraFile = None,
    config: ConfigFile = None,
    classes: Annotated[
        str | None, arg(metavar="A,B,…", help="Classes that go on the map; all mapped ones by default.")
    ] = None,
    confidence: Confidence = None,
    clustering: Annotated[
        Literal["default", "paper"],
        arg(help="default: association under both covariances; paper: single linkage per label at 1 m."),
    ] = "default",
    loop_closure: LoopClosure = True,
    saved: SavedMap = None,
    start: StartText = None,
    forget: Forget = "auto",
    edited: EditsFile = None,
    out: Annotated[
        Path | None, arg(aliases=["-o"], metavar="DIR", help="The run folder; runs/<UTC stamp>/ by default.")
    ] = None,
    frames: Annotated[int | None, arg(metavar="N", help="Stop after N frames.")] = None,
    realtime: Annotated[bool, arg(help="Pace files by their stamps, not at full speed.")] = False,
    view: Annotated[
        bool,
        arg(
            help="Serve a live page for browsers. Files are then paced by their stamps, as --realtime does, and the "
            "page stays after the last frame until Ctrl-C."
        ),
    ] = False,
    view_host: Annotated[
        str,
        arg(
            metavar="ADDRESS",
            help="Address to serve it on; 0.0.0.0 for every network. Beyond this machine viewers need the token that "
            "is printed with the page's address.",
        ),
    ] = "127.0.0.1",
    view_port: Annotated[int, arg(metavar="PORT", help="Port to serve it on; 0 for any free one.")] = 8090,
    recording: Annotated[
        Path | None,
        arg(name="record", metavar="FILE.mcap", help="Record pictures and results, to be replayed."),
    ] = None,
    lossless: Annotated[bool, arg(help="Record PNG, not JPEG: a replay gives the very same map.")] = False,
    foxglove: Foxglove = None,
    rerun: Rerun = None,
    rerun_pictures: RerunPictures = 1.0,
    mqtt: MqttBroker = None,
    fleet: Fleet = None,
    robot: RobotName = None,
    ros2: Ros2 = False,
    ros2_pictures: Ros2Pictures = False,
    ros2_best_effort: Ros2BestEffort = False,
    ros2_namespace: Ros2Namespace = "edgemap",
    ros2_frames: Ros2Frames = FRAMES,
    odom_tf: OdomTf = True,
    wheel_topic: WheelTopic = None,
    imu_topic: ImuTopic = None,
    depth_topic: DepthTopicName = None,
    threads: Threads = None,
    precision: PrecisionName = "default",
    engine: EngineName = "default",
    cpu: CpuShare = None,
    temperature: Temperature = None,
    strict: Annotated[
        bool, arg(help="End at the first camera fault (a damaged picture, a late frame), not go on past it.")
    ] = False,
    allow_untrained: Annotated[
        bool, arg(help="Run --odometry paper although its weights are untrained (its motion is noise).")
    ] = False,
) -> None:
    """Drive from a camera to a map of the objects on the floor.

    Frames go through detector, floor projection, odometry and map; Ctrl-C ends the run with the map saved. Writes
    map.json, trajectory.tum, sightings.jsonl, run.json, mount.jpg (the first picture with horizon and metre grid, by
    which to check the mount) and report.html. Where the source knows what stands there, the map is judged by it.
    """
    options = typed_options(command, locals())
    from dataclasses import asdict

    from edgemap.cli.live_page import live_page
    from edgemap.cli.record import check_name, recording_sinks
    from edgemap.cli.truth import judge_of
    from edgemap.geometry.camera.floor import FloorCamera
    from edgemap.geometry.errors import EdgemapError, MapError
    from edgemap.runtime.cameras.protocol import SensorTopics
    from edgemap.runtime.config import Config, config_document, load_config
    from edgemap.runtime.edits import Edits, load_edits, read_edits
    from edgemap.runtime.errors import RunFolderError
    from edgemap.runtime.loop import run, stop_on_signals
    from edgemap.runtime.network import Decisions
    from edgemap.runtime.report.crops import BestCrops
    from edgemap.runtime.report.sink import ReportFile
    from edgemap.runtime.service import ServiceNotifier
    from edgemap.runtime.session import SlamOptions, build_slam
    from edgemap.runtime.sinks.progress import Progress
    from edgemap.runtime.sinks.run_folder import RunFolder

    at_least(1, frames=frames)
    check_name(recording)
    share = read_share(cpu)
    watched = foxglove is not None or ros2 or share is not None or temperature is not None
    tuned = load_config(config)[0] if config else Config()
    topics = SensorTopics(wheel_topic, imu_topic, depth_topic, frame_names(ros2_frames)[3])
    paced = (realtime or watched) and not view
    with open_described(camera, camera_file, paced, frames, tuned.camera, topics, not without_depth) as source:
        pace = "camera" if source.live or realtime or view or watched else "files"
        loaded = find_bundle(bundle, threads, precision, camera, pace=pace, engine=engine, recorded=source.decisions)
        threshold = minimum_score(confidence, loaded)
        mapped = choose_classes(classes, loaded)
        lens, camera_mount = lens_and_mount(source, intrinsics, mount)
        floor = FloorCamera(lens, camera_mount)
        # The network for whole inputs may go now.
        loaded = loaded.for_pictures(lens.width, lens.height, odometry == "paper")
        chosen = SlamOptions(
            odometry, not without_wheels, not without_imu, clustering, loop_closure, forgets(forget, saved, clustering),
            allow_untrained, mapped, threshold,
        )  # fmt: skip
        slam = build_slam(source, loaded, floor, chosen, tuned)
        enter_saved_map(slam.mapper, saved, start, clustering)
        folder = out or Path("runs") / datetime.now(UTC).strftime("%Y%m%dT%H%M%SZ")
        record = _record(source, loaded, floor, odometry, clustering, threshold, sorted(mapped))
        record |= {"loop_closure": slam.mapper.loop_closer.closes_loops, "trajectory": "as known at the end"}
        record |= {"map": str(saved), "start": start} if saved else {}
        decided = Decisions(loaded.engine, loaded.precision)
        usual = asdict(Decisions())
        options |= {name: one for name, one in asdict(decided).items() if name in options or one != usual[name]}
        record |= {"options": options, "config": config_document(tuned)}
        crops = BestCrops()
        edits = Edits(
            folder / "edits.jsonl", load_edits(edited) if edited else read_edits(source.edits, f"{camera}: edits")
        )
        with (
            stop_on_signals() as stop,  # from here on there is something to save
            live_page(view, view_host, view_port, source, loaded, floor, odometry, folder, crops, edits) as page,
        ):
            latest = _Latest()
            judge = None if saved else judge_of(camera, source, mapped if classes else None)
            report = ReportFile(folder, None if saved else source.truth, judge, crops)
            progress = Progress(frames or source.frame_count)
            publishers = open_publishers(floor, foxglove, rerun, rerun_pictures, mqtt, robot) + fleet_sinks(
                fleet, robot, saved
            )
            tape = recording_sinks(recording, lossless, source, floor, odometry, decided)
            live = ros2_sinks(
                ros2, source, floor, namespace=ros2_namespace, frames=ros2_frames, pictures=ros2_pictures,
                best_effort=ros2_best_effort, odom_tf=odom_tf,
            )  # fmt: skip
            notifier = ServiceNotifier()
            seen = budgeted(source, share, temperature, config)
            files = RunFolder(folder, floor, record | {"cpu": share, "efforts": seen.efforts})
            edits.listeners += [files.edited, report.edited]
            edits.recorders += [sink.edit for sink in tape]

            def beat(text: str) -> None:
                notifier.beat(text + seen.status)

            # The folder last but for the report, which reads it: what goes wrong with the others stands in run.json.
            sinks: list[Sink] = [progress, latest, *tape, *publishers, *live, *page.sinks, files, report]
            try:
                done = run(page.camera(seen, stop), slam, sinks, frames, stop, strict, beat, edits)
            except EdgemapError as error:
                if latest.result is None or isinstance(error, (MapError, RunFolderError)):
                    raise
                so_far = f"the map so far ({len(latest.objects)} objects) is in {folder}/"
                error.args = (f"{error}; {so_far}",)
                raise
            finally:
                notifier.stopping()
            print(f"map of {len(latest.objects)} objects saved in {folder}/")
            _summary(done, latest, camera_mount, stop.is_set(), report.evaluation_rows)
            if line := where_it_was(slam.mapper, saved):
                print(line)
            print(report.failure or f"see it:  {report.path}")
            page.stay(stop, lambda: edits.apply(slam.mapper, done))


class _Latest:
    """A sink that keeps the last result, for the summary."""

    name = "summary"

    def __init__(self) -> None:
        self.result: StepResult | None = None
        self.objects: list[MapObject] = []

    def write(self, result: StepResult, objects: list[MapObject]) -> None:
        """Keep it."""
        self.result, self.objects = result, objects

    def fault(self, text: str) -> None:
        """Faults stand in run.json."""

    def close(self) -> None:
        """Nothing to close."""


def _summary(done: int, latest: _Latest, mount: Mount, stopped: bool, evaluation_rows: list[EvaluationRow]) -> None:
    from edgemap.cli.truth import object_lines
    from edgemap.runtime.calibration.level import seen_text

    end = "stopped" if stopped else "done"
    travelled_m = latest.result.travelled_m if latest.result else 0.0
    headline = f"{end} after {done} frames, {travelled_m:.1f} m travelled"
    seen = latest.result.observed.mount_seen if latest.result else None
    told = [seen_text(mount, seen)] if seen else []
    print("\n".join([headline, *told, *object_lines(latest.objects, evaluation_rows)]))


def _record(
    source: Camera, loaded: Any, floor: Any, odometry: str, clustering: str, confidence: float, mapped: list[str]
) -> dict[str, Any]:
    """What run.json says of the run."""
    import math
    import platform
    from dataclasses import asdict
    from importlib.metadata import version

    from edgemap import __version__

    camera_mount = floor.mount
    return {
        "format": "edgemap.run/1",
        "started_utc": datetime.now(UTC).isoformat(timespec="seconds"),
        "camera": source.name,
        "intrinsics": asdict(floor.intrinsics),
        "mount": {
            "height_m": camera_mount.height_m,
            "pitch_deg": round(math.degrees(camera_mount.pitch_rad), 6),
            "roll_deg": round(math.degrees(camera_mount.roll_rad), 6),
            "forward_m": camera_mount.forward_m,
            "left_m": camera_mount.left_m,
        },
        "bundle": {"name": loaded.manifest.name, "folder": str(loaded.folder), "sha256": loaded.manifest.sha256},
        "odometry": odometry,
        "clustering": clustering,
        "confidence": confidence,
        "mapped": mapped,
        "threads": loaded.compute.threads,
        "spinning": loaded.compute.spin,
        "engine": loaded.compute.engine,
        "precision": loaded.precision,
        "versions": {"edgemap": __version__}
        | {name: version(name) for name in ("onnxruntime", "numpy", "opencv-python-headless")},
        "machine": {"system": platform.platform(), "python": platform.python_version()},
    }
