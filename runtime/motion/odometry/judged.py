"""Poses that carry the map, judged by the camera's motion, which takes their place where they are wrong."""

import math
from collections import deque
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from edgemap.geometry.camera.attitude import Attitude
from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.faults import Fault, FaultKind
from edgemap.runtime.frames.frame import Frame
from edgemap.runtime.frames.timing import StreamTimer
from edgemap.runtime.frames.trajectory import PoseTrack, Trajectory
from edgemap.runtime.motion.given_poses import GivenPoses
from edgemap.runtime.motion.health import REPEATED_S
from edgemap.runtime.motion.judge import MotionJudge, path_of
from edgemap.runtime.motion.odometry.hybrid import HybridOdometry
from edgemap.runtime.motion.odometry.protocol import NO_PRIOR, FramePrior, Motion, MotionState
from edgemap.runtime.motion.odometry.recorded import RecordedOdometry
from edgemap.runtime.network.network import Tensors

# The external odometry from the first frame's stamp on, with a file's attitudes where there are any.
OpenPoses = Callable[[float], tuple[RecordedOdometry, GivenPoses | None]]


class JudgedOdometry:
    """The external motion; the camera's where that measures none, and for good once it contradicts it.

    The map's latest poses become the camera's then. kind: of the fault that leaves the source out. start: the first
    frame's pose in the source's map; None where that begins there.
    """

    needs_features = False

    def __init__(
        self,
        name: str,
        open_poses: OpenPoses,
        camera: HybridOdometry,
        judge: MotionJudge,
        kind: FaultKind,
        start: SE2 | None = None,
    ) -> None:
        self.name, self._open, self._camera, self._judge, self._kind = name, open_poses, camera, judge, kind
        self.start = start
        self._opened: tuple[RecordedOdometry, GivenPoses | None] | None = None
        self._wrong, self._news, self._gaps = False, list[Fault](), StreamTimer(REPEATED_S)
        self._last_s = -math.inf
        self._path = deque[tuple[float, SE2]]()  # the camera's, as long as the judge looks back

    def attitude(self, stamp_s: float) -> Attitude | None:
        """The camera's attitude by poses of six dimensions; None where they have three, or are wrong."""
        given = self._given(stamp_s)[1]
        return None if self._wrong or given is None else given.attitude(stamp_s)

    def step(self, frame: Frame, features: Tensors, prior: FramePrior = NO_PRIOR) -> Motion:
        """The external motion since the last frame, or the camera's."""
        seen = self._camera.step(frame, features, prior)
        given = self._given(frame.stamp_s)[0].step(frame, features, prior)
        due, self._last_s = self._judge.add(self._last_s, frame.stamp_s, seen.moved()), frame.stamp_s
        if due and not self._wrong:
            self._judge_now(self._given(frame.stamp_s)[0].trajectory, frame.stamp_s)
        return self._chosen(replace(given, rotation=seen.rotation), seen, frame.stamp_s)

    def step_blind(self, stamp_s: float, reason: Fault, attitude: Attitude | None = None) -> Motion:
        """The external motion; it needs no picture."""
        seen = self._camera.step_blind(stamp_s, reason, attitude)
        self._last_s = -math.inf
        return self._chosen(self._given(stamp_s)[0].step_blind(stamp_s, reason, attitude), seen, stamp_s)

    def still(self, stamp_s: float, attitude: Attitude | None) -> bool | None:
        """Whether the source that is used stands still."""
        return (self._camera if self._wrong else self._given(stamp_s)[0]).still(stamp_s, attitude)

    def rest(self, stamp_s: float) -> Motion:
        """Both rest."""
        self._last_s = stamp_s
        return self._chosen(self._given(stamp_s)[0].rest(stamp_s), self._camera.rest(stamp_s), stamp_s)

    def _given(self, stamp_s: float) -> tuple[RecordedOdometry, GivenPoses | None]:
        if self._opened is None:
            self._opened = self._open(stamp_s)
            given = self._opened[1]
            if given is not None and given.read_as:
                text = f"odometry {self.name}: {', '.join(given.read_as)}: read as such, state it or convert the file"
                self._news.append(Fault(FaultKind.POSES_CONVERTED, text))
        return self._opened

    def _judge_now(self, track: PoseTrack, stamp_s: float) -> None:
        """Judges the poses about a stamp: of a long file no others count."""
        stamps_s, reach_s = track.stamps_s, self._judge.reach_s
        first, end = np.searchsorted(stamps_s, [stamp_s - reach_s, stamp_s + reach_s]).tolist()
        near = slice(max(first - 1, 0), end + 1)
        poses = np.array([pose.vector() for pose in track.poses[near]]).reshape(-1, 3)
        if wrong := self._judge.judge(path_of(stamps_s[near], poses)):
            self._wrong = True
            text = f"odometry {self.name}: {wrong}: left out, the camera's own motion is used"
            self._news.append(Fault(self._kind, text))

    def _chosen(self, given: Motion, seen: Motion, stamp_s: float) -> Motion:
        """The motion that is used, with what there is to report."""
        news, self._news = tuple(self._news), []
        motion = seen if self._wrong else given
        if not given.blind:
            self._gaps.done()
        elif not self._wrong and seen.state is not MotionState.UNMEASURED:
            reported = given.faults if self._gaps.due(stamp_s) else ()
            motion = replace(seen, faults=(*seen.faults, *reported))
        excluded = any(fault.kind is self._kind for fault in news)
        self._path.append((stamp_s, self._path[-1][1] @ seen.motion if self._path else SE2()))
        while self._path[0][0] < stamp_s - self._judge.reach_s:
            self._path.popleft()
        poses = None if self._wrong else self._given(stamp_s)[1]
        if excluded:
            motion = replace(motion, instead=self._seen_at)
        elif poses is not None and (corrected := poses.correction(stamp_s)) is not None:
            motion = replace(motion, instead=corrected, in_map=True)
        return replace(motion, faults=(*motion.faults, *news)) if news else motion

    def _seen_at(self, stamp_s: float) -> SE2 | None:
        """The camera's pose at a stamp, in a separate frame; None where unknown."""
        path = Trajectory(np.array([row[0] for row in self._path]), tuple(row[1] for row in self._path))
        return path.at(stamp_s) if path.stamps_s[0] <= stamp_s <= path.stamps_s[-1] else None
