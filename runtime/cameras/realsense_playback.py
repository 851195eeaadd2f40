"""Starting and stopping librealsense's pipelines so that a recording is read completely, and let go of safely."""

import time
from types import ModuleType
from typing import Any

POLL_MS = 200  # of one wait for a frame
SILENT_POLLS = 50  # 10 s of a recording that neither delivers nor ends
BEGIN_LIMIT_S = 2.0


def as_fast_as_read(rs: ModuleType, pipeline: Any, config: Any) -> Any:
    """The playback of a recording, out of real time; call it before the start: in real time, playback drops the
    pictures that come before the pipeline waits for them. False where the configuration names a device."""
    playback = config.resolve(rs.pipeline_wrapper(pipeline)).get_device().as_playback()
    if playback:
        playback.set_real_time(False)
    return playback


def started(rs: ModuleType, pipeline: Any, config: Any) -> Any:
    """The profile of a pipeline that was started; of a recording, whose status says from now on when it has ended."""
    profile = pipeline.start(config)
    if playback := profile.get_device().as_playback():
        await_begin(rs, playback)
    return profile


def await_begin(rs: ModuleType, playback: Any) -> None:
    """Wait until the thread that reads a recording has begun: before that its status is that of one that has ended, and
    what is stopped would begin afterwards. One that is over before anybody looks costs `BEGIN_LIMIT_S`."""
    until_s = time.monotonic() + BEGIN_LIMIT_S
    while playback.current_status() == rs.playback_status.stopped and time.monotonic() < until_s:
        time.sleep(0.001)


def stop(pipeline: Any) -> None:
    """Stop a pipeline, and where it plays a recording also the thread that reads the file."""
    playback = pipeline.get_active_profile().get_device().as_playback()
    pipeline.stop()
    if playback:
        caught_up(playback)


def caught_up(playback: Any) -> None:
    """Wait until the thread that reads a recording has done all that it was asked to.

    A playback that is let go of before that ends the process: librealsense's thread goes on with a device that is no
    more (2.59: `stop_internal` after `~playback_device`). Resuming what is not paused does nothing but wait for it;
    twice, since reading on may have been asked for behind the first.
    """
    playback.resume()
    playback.resume()
