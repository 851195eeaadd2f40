"""The loop of a run: frames from a camera through front end and back end into sinks, until the end or a stop."""

import threading
from collections.abc import Callable, Generator, Sequence

from edgemap.geometry.errors import EdgemapError
from edgemap.runtime.frames.camera import Camera
from edgemap.runtime.frames.errors import CameraFault, CameraState, FrameTimeout
from edgemap.runtime.frames.faults import Fault, FaultKind
from edgemap.runtime.step.edit_queue import Edits
from edgemap.runtime.step.sinks import Sink, SinkGroup
from edgemap.runtime.step.slam import SemanticSlam, StepResult


def steps(
    camera: Camera,
    slam: SemanticSlam,
    sinks: Sequence[Sink] = (),
    frames: int | None = None,
    stop: threading.Event | None = None,
    strict: bool = False,
    beat: Callable[[str], None] = lambda _: None,
    edits: Edits | None = None,
) -> Generator[StepResult, None, None]:
    """Drive until the camera ends, `frames` are done, `stop` is set or the iterator is closed; one result a frame.

    Camera faults are reported to the sinks and the run continues; strict: the first one ends it. While a live camera is
    disconnected, sources that need no picture update the pose. beat: called with one line at every step, and every half
    second without a frame. edits: applied between two steps. A sink that fails is reported as a fault (`SinkGroup`).
    Sinks are closed in every case, so the map so far is on disk. An EdgemapError is reported to the sinks before it is
    raised again.
    """
    done = 0
    group, edits = SinkGroup(sinks), edits or Edits()

    def take_edits() -> None:
        for fault in edits.apply(slam.mapper, done):
            group.fault(fault)

    try:
        for fault in camera.info.faults:
            group.fault(fault)
        while (frames is None or done < frames) and not (stop and stop.is_set()):
            take_edits()
            try:
                frame = camera.read()
            except FrameTimeout as timeout:
                if done and timeout.stamp_s is not None and timeout.state is not CameraState.RUNNING:
                    slam.step_blind(timeout.stamp_s, Fault(FaultKind.LATE, str(timeout)))
                beat(f"camera {timeout.state}, {done} frames")
                continue
            except CameraFault as error:
                if strict and not error.fault.kind.notice:
                    raise
                group.fault(error.fault)
                continue
            if frame is None:
                break
            result = slam.step(frame, group.faults_since())
            objects = slam.objects()
            group.write(result, objects)
            done += 1
            beat(f"camera {CameraState.RUNNING}, {done} frames, {len(objects)} objects")
            yield result
        for fault in camera.account():
            group.fault(fault)
        take_edits()
    except EdgemapError as error:
        group.ending(error)
        raise
    finally:
        if (late := slam.finish()) is not None:
            group.last(late, slam.objects())
        group.close()
