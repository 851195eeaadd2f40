"""`edgemap run`: the main job."""

from typing import Annotated

from edgemap.cli.arguments import arg
from edgemap.cli.groups import MotionOptions
from edgemap.cli.run_options import (
    AdvancedGroup,
    CameraGroup,
    MapGroup,
    OutputGroup,
    RunOptions,
    WatchGroup,
)
from edgemap.runtime.frames.reading import printable


def command(
    camera: Annotated[CameraGroup, arg(name="Camera")],
    robot: Annotated[MotionOptions, arg(name="Robot")],
    map: Annotated[MapGroup, arg(name="Map")],
    watch: Annotated[WatchGroup, arg(name="Watch")],
    outputs: Annotated[OutputGroup, arg(name="Outputs")],
    advanced: Annotated[AdvancedGroup, arg(name="Advanced")],
) -> None:
    """Drive from a camera to a map of the objects on the floor.

    Frames go through detector, floor projection, odometry and map; Ctrl-C ends the run with the map saved. Writes
    map.json, trajectory.tum, sightings.jsonl, run.json, mount.jpg (the first picture with horizon and metre grid, by
    which to check the mount) and report.html. Where the source knows what stands there, the map is judged by it.

    Four examples:

      edgemap run                                                  the demo drive
      edgemap run --camera realsense --view                        its depth measures how it is mounted; live page
      edgemap run --camera 0 --mount 0.60                          a webcam 0.60 m up; lens and pitch are guessed
      edgemap run --camera drive.mp4 --camera-file camera.yaml -o kitchen/      a video, into a folder of its own
    """
    options = RunOptions(camera, robot, map, watch, outputs, advanced)
    options.check()
    from edgemap.cli.drive import Run
    from edgemap.cli.guessed_camera import floor_camera_of
    from edgemap.runtime.frames.camera import CameraOptions, check_size
    from edgemap.runtime.step.config import Config, load_config

    tuned = load_config(advanced.config) if advanced.config else Config()
    pace_files = options.pace_files and watch.view is None
    how = CameraOptions(
        realtime=pace_files, recovery=tuned.camera, topics=options.sensors(), depth=not camera.without_depth,
        frames=camera.frames,
    )  # fmt: skip
    with camera.open(how) as source:
        check_size(source)
        for note in source.info.notes:
            print(printable(note))
        paced = source.info.live or watch.view is not None or options.pace_files  # as many threads as pay then
        loaded = advanced.load(camera.camera, pace="camera" if paced else "files", recorded=source.info.inference)
        floor, guess = floor_camera_of(camera, source, loaded, how)
        lens = floor.intrinsics
        if robot.odometry != "paper":  # the network for whole inputs may go now
            loaded = loaded.for_pictures(lens.width, lens.height)
        Run(options, source, loaded, floor, tuned, guess).drive()
