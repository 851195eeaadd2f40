"""One run of the command: the step, its sinks, and what is printed."""

import time
from contextlib import ExitStack
from datetime import UTC, datetime
from math import degrees
from pathlib import Path
from threading import Event
from typing import TYPE_CHECKING

from edgemap.cli.guessed_camera import CameraKeeper
from edgemap.cli.named_maps import find_place
from edgemap.cli.options import minimum_score
from edgemap.cli.progress import Progress
from edgemap.cli.run_options import RunOptions
from edgemap.cli.run_record import run_record, scale_source
from edgemap.cli.service import ServiceNotifier
from edgemap.cli.signals import stop_on_signals
from edgemap.cli.summary import RunSummary, judge_of, with_map_so_far
from edgemap.geometry.camera.floor import FloorCamera
from edgemap.runtime.compose import RunSpec, compose, mapped_classes
from edgemap.runtime.frames.camera import Camera
from edgemap.runtime.frames.errors import RunFolderError
from edgemap.runtime.frames.inference import Inference
from edgemap.runtime.frames.option_texts import host_and_port
from edgemap.runtime.inputs.cameras.wrappers import PacedCamera, SearchRate
from edgemap.runtime.motion.camera_guess import CameraGuess
from edgemap.runtime.network.bundle import Bundle
from edgemap.runtime.network.manifest_file import write_manifest
from edgemap.runtime.outputs.sinks.kinds import RunInfo, open_sinks
from edgemap.runtime.outputs.sinks.living_map import LivingMap
from edgemap.runtime.outputs.sinks.run_folder import RunFolder
from edgemap.runtime.outputs.verdict.verdict import Verdict
from edgemap.runtime.step.config import Config
from edgemap.runtime.step.edit_queue import Edits, load_edits, read_edits
from edgemap.runtime.step.loop import steps
from edgemap.runtime.step.map_store import AUTO
from edgemap.runtime.step.mapper import Mapper
from edgemap.runtime.step.sinks import Sink
from edgemap.view.about import about_run
from edgemap.view.pause import PausableCamera
from edgemap.view.report.crops import BestCrops
from edgemap.view.report.sink import ReportFile

if TYPE_CHECKING:
    from edgemap.view.server import PageServer

LOOK_EVERY_S = 0.1
WITHOUT = ",without-pictures"


def where_it_was(mapper: Mapper, saved: str | None) -> str | None:
    """Result of the relocalisation in the saved map, in one line; None where there was none."""
    search = mapper.relocaliser
    if search is None:
        return None
    if str(saved) == AUTO:
        saved = str(search.saved.path) if search.saved else "any named map"
    if search.alignment is None:
        return f"not found in {saved}, so this run's map stands alone in its own frame: {search.reason}"
    pose, count = search.alignment.pose_a_b, len(search.alignment.pairs)
    how = f"{count} objects" if count else "a pose that was set"
    return (
        f"found in {saved} by {how}: the start was at x {pose.x_m:.2f} m, "
        f"y {pose.y_m:.2f} m, yaw {degrees(pose.yaw_rad):.1f} deg"
    )


class Run:
    """One run: makes pipeline, mapper and sinks from the options, and drives the source through them."""

    def __init__(
        self,
        options: RunOptions,
        source: Camera,
        loaded: Bundle,
        floor: FloorCamera,
        tuned: Config,
        guess: CameraGuess | None,
    ) -> None:
        robot, chosen = options.robot, options.map
        self.options, self.source, self.loaded, self.floor = options, source, loaded, floor
        self.threshold = minimum_score(chosen.confidence, loaded)
        self.place, self.strict = chosen.place(), tuned.camera.strict
        if self.place and self.place.lives and not self.place.exists:
            print(f"new map: {self.place.path}/", flush=True)
        spec = RunSpec(
            odometry=robot.odometry, pose_frame=robot.pose_frame, wheels=not robot.without_wheels,
            imu=not robot.without_imu, clustering=chosen.clustering, loop_closure=chosen.loop_closure,
            classes=chosen.named_classes, confidence=chosen.confidence, map=chosen.saved,
            start=chosen.start, config=tuned,
        )  # fmt: skip
        self.slam, self.mapped = compose(source, loaded, floor, spec, guess), mapped_classes(spec.classes, loaded)
        self.finder = find_place(self.slam.mapper) if chosen.auto else None
        self.folder = options.outputs.out or Path("runs") / datetime.now(UTC).strftime("%Y%m%dT%H%M%SZ")
        self.kept_camera = CameraKeeper(self.folder, floor, guess, options.camera.camera)
        self.record = run_record(options, source, loaded, floor, self.threshold, self.mapped, tuned)
        self.record |= {"loop_closure": self.slam.mapper.closes_loops}
        self.record |= {"camera_guess": guess.record()} if guess else {}
        self.record |= {"companion": loaded.companion.manifest.name} if loaded.companion else {}
        guessed = (guess.pitch_sigma_rad, guess.height_sigma) if guess else (0.0, 0.0)
        angles, height = ("guessed" if sigma else "given" for sigma in guessed)
        self.summary = RunSummary(floor.mount, (angles, height), bool(guess and guess.sway_rad))
        self.crops = BestCrops()
        self.files: RunFolder | None = None
        counts = (options.camera.frames, source.info.frame_count)
        self._frames = min((count for count in counts if count is not None), default=None)
        self.about = about_run(source, loaded, floor, robot.odometry, self.folder, self._frames)

    def drive(self) -> None:
        """Drive until the source ends, `--frames` is reached or a signal arrives; then print the result."""
        repeated, spec = self.options.advanced.repeated_edits(), self.options.camera.camera
        given = load_edits(repeated) if repeated else read_edits(self.source.info.edits, f"{spec}: edits")
        edits = Edits(self.folder / "edits.jsonl", given)
        with ExitStack() as held:
            stop = held.enter_context(stop_on_signals())  # from here on there is something to save
            if (kept := self._living_map()) is not None:
                held.callback(kept.release)
            if (server := self._page_server(edits)) is not None:
                held.callback(server.close)
            self._drive_with(server, stop, edits, kept)

    def _living_map(self) -> LivingMap | None:
        """The sink that saves a map that lives back. Raises DiskError or RunFolderError."""
        finder, place = self.finder, self.place
        if finder is not None:
            return LivingMap(lambda: finder.saved and finder.saved.path, bool, self._verdict, self._complete)
        if place is not None and place.lives:
            return LivingMap(place.path, lambda: self.slam.mapper.searching, self._verdict, self._complete)
        return None

    def _page_server(self, edits: Edits) -> "PageServer | None":
        """The server of the run's page; None without `--view`. A file source can be paused; a live camera runs on.

        Raises MissingExtraError, or ViewError where the address is taken.
        """
        view, source = self.options.watch.view, self.source
        if view is None:
            return None
        from edgemap.view.page import LivePage
        from edgemap.view.pause import Pause
        from edgemap.view.server import PageServer

        pause, pictures = None if source.info.live else Pause(), not view.endswith(WITHOUT)
        page = LivePage(self.about, self.folder, pause, lambda: source.state, self.crops, edits, pictures)
        page.searching, page.keep_mount = lambda: self.slam.mapper.searching, self.kept_camera.set_mount
        page.verdict = lambda: self.files.verdict if self.files else None
        page.camera_hz = lambda: source.info.rate_hz
        server = PageServer(page, *host_and_port(view.removesuffix(WITHOUT) or "127.0.0.1", "--view", 8090))
        print(f"live page:  {server.url}", flush=True)
        return server

    def _verdict(self) -> Verdict:
        """How far the map can be trusted."""
        return self.files.judge() if self.files else Verdict("care")

    def _complete(self) -> None:
        if self.files:
            self.files.complete()

    def _drive_with(self, server: "PageServer | None", stop: Event, edits: Edits, kept: LivingMap | None) -> None:
        camera, saved = self.options.camera, self.options.map.saved
        notifier, summary = ServiceNotifier(), self.summary
        source = SearchRate(self.source, camera.rate) if camera.rate else self.source
        publishers, page = self._publishers(edits), server.page if server else None
        files = self.files = RunFolder(self.folder, self.floor, self.record)
        if self.loaded.manifest.detector.reading is not None:  # how the detector's file was read
            write_manifest(self.folder, self.loaded.manifest)
        self.kept_camera.begin()
        judge = (
            None if saved else judge_of(camera.camera, self.source, self.mapped if self.options.map.classes else None)
        )
        report = ReportFile(self.folder, self.about, None if saved else self.source.info.truth, judge, self.crops)
        if page is not None:
            page.goals += [send for one in publishers if (send := getattr(one, "send_goal", None))]
            if page.pause is not None:
                source = PausableCamera(PacedCamera(source, page.pause.running_s), page.pause, stop.is_set)
        living, pages = [] if kept is None else [kept], [] if page is None else [page]
        edits.listeners += [files.edited, report.edited, *(one.edited for one in living)]

        # The folder last but for the report, which reads it: what goes wrong with the others stands in run.json.
        sinks: list[Sink] = [Progress(self._frames), summary, *publishers, *living, *pages, files, report]
        try:
            with with_map_so_far(summary, files):
                results = steps(source, self.slam, sinks, camera.frames, stop, self.strict, notifier.beat, edits)
                done = sum(1 for _ in results)
        finally:
            notifier.stopping()
        summary.print(self.folder, done, stop.is_set(), files.verdict, report.evaluation_rows)
        if line := where_it_was(self.slam.mapper, saved):
            print(line)
        if kept is not None and kept.beside:
            print(kept.beside)
        if result := summary.result:
            alone = not scale_source(files.document)
            if line := self.kept_camera.at_end(result.observed, summary.height, summary.rolling, alone):
                print(line)
        if not report.failure:
            print(f"see it:  {report.path}")
        if server is not None and not stop.is_set():
            print(f"the page stays at {server.url}  (Ctrl-C ends it)", flush=True)
            with stop_on_signals() as enough:
                while not enough.is_set():
                    edits.apply(self.slam.mapper, done)
                    time.sleep(LOOK_EVERY_S)
        edits.close(self.slam.mapper)
        if report.failure:
            raise RunFolderError(report.failure)

    def _publishers(self, edits: Edits) -> list[Sink]:
        """Sinks of the recording and of other programs."""
        inference, guess = Inference(self.loaded.compute.engine, self.loaded.precision), self.record.get("camera_guess")
        saved = self.place.path if self.place and self.place.exists else None
        run = RunInfo(
            self.folder, self.source, self.floor, edits, inference, saved, guess, self._verdict, self.loaded.names,
            self.threshold,
        )  # fmt: skip
        return open_sinks(self.options.sinks, run)
