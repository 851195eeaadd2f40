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
from edgemap.runtime.frames.trajectory import Trajectory
from edgemap.runtime.motion.given_poses import GivenPoses
from edgemap.runtime.motion.health import REPEATED_S
from edgemap.runtime.motion.judge import MotionJudge, path_of
from edgemap.runtime.motion.odometry.hybrid import HybridOdometry
from edgemap.runtime.motion.odometry.protocol import NO_PRIOR, FramePrior, Motion, MotionState, Odometry
from edgemap.runtime.motion.odometry.recorded import DriftRate, RecordedOdometry
from edgemap.runtime.network.network import Tensors


class JudgedOdometry(Odometry):
    """The external motion; the camera's where that measures none, and for good once it contradicts it.

    The map's latest poses become the camera's then. open_poses: the external poses, from the first frame's stamp on.
    kind: of the fault that leaves them out. drift: their errors. start: the first frame's pose in their map; None where
    that begins there.
    """

    def __init__(
        self,
        name: str,
        open_poses: Callable[[float], GivenPoses],
        camera: HybridOdometry,
        judge: MotionJudge,
        kind: FaultKind,
        drift: DriftRate | None = None,
        start: SE2 | None = None,
    ) -> None:
        self.name, self._open, self._camera, self._judge, self._kind = name, open_poses, camera, judge, kind
        self._drift, self.start = drift, start
        self._opened: tuple[RecordedOdometry, GivenPoses] | None = None
        self._wrong, self._gaps = False, StreamTimer(REPEATED_S)
        self._news: Fault | None = None  # how the poses were read
        self._last_s = -math.inf
        self._path = deque[tuple[float, SE2]]()  # the camera's, as long as the judge looks back

    def attitude(self, stamp_s: float) -> Attitude | None:
        """The camera's attitude by poses of six dimensions; None where they have three, or are wrong."""
        return None if self._wrong else self._given(stamp_s)[1].attitude(stamp_s)

    def step(self, frame: Frame, features: Tensors, prior: FramePrior = NO_PRIOR) -> Motion:
        """The external motion since the last frame, or the camera's."""
        stamp_s, seen = frame.stamp_s, self._camera.step(frame, features, prior)
        given = self._given(stamp_s)[0].step(frame, features, prior)
        given = replace(given, rotation=seen.rotation, without_gyro=seen.moved())  # the IMU is judged by the camera
        due, self._last_s = self._judge.add(self._last_s, stamp_s, seen.moved()), stamp_s
        return self._chosen(given, seen, stamp_s, self._contradicted(stamp_s) if due and not self._wrong else "")

    def step_blind(self, stamp_s: float, reason: Fault | None, attitude: Attitude | None = None) -> Motion:
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

    def _given(self, stamp_s: float) -> tuple[RecordedOdometry, GivenPoses]:
        if self._opened is None:
            given = self._open(stamp_s)
            self._opened = RecordedOdometry(given.trajectory, self.name, self._drift), given
            if given.read_as:
                text = f"odometry {self.name}: {', '.join(given.read_as)}: read as such, state it or convert the file"
                self._news = Fault(FaultKind.POSES_CONVERTED, text)
        return self._opened

    def _contradicted(self, stamp_s: float) -> str:
        """What is wrong with the poses about a stamp: of a long file no others count. Empty where nothing is."""
        track, reach_s = self._given(stamp_s)[1].trajectory, self._judge.reach_s
        first, end = np.searchsorted(track.stamps_s, [stamp_s - reach_s, stamp_s + reach_s]).tolist()
        near = slice(max(first - 1, 0), end + 1)
        poses = np.array([pose.vector() for pose in track.poses[near]]).reshape(-1, 3)
        return self._judge.judge(path_of(track.stamps_s[near], poses))

    def _chosen(self, given: Motion, seen: Motion, stamp_s: float, wrong: str = "") -> Motion:
        """The motion that is used, with what there is to report. wrong: what the poses have just proved to be."""
        self._wrong |= bool(wrong)
        motion = seen if self._wrong else given
        if not given.blind:
            self._gaps.done()
        elif not self._wrong and seen.state is not MotionState.UNMEASURED:
            reported = given.faults if self._gaps.due(stamp_s) else ()
            motion = replace(seen, faults=(*seen.faults, *reported))
        self._path.append((stamp_s, self._path[-1][1] @ seen.motion if self._path else SE2()))
        while self._path[0][0] < stamp_s - self._judge.reach_s:
            self._path.popleft()
        if self._news is not None:
            motion, self._news = replace(motion, faults=(*motion.faults, self._news)), None
        if wrong:
            text = f"odometry {self.name}: {wrong}: left out, the camera's own motion is used"
            return replace(motion, instead=self._seen_at, faults=(*motion.faults, Fault(self._kind, text)))
        corrected = None if self._wrong else self._given(stamp_s)[1].correction(stamp_s)
        return motion if corrected is None else replace(motion, instead=corrected, in_map=True)

    def _seen_at(self, stamp_s: float) -> SE2 | None:
        """The camera's pose at a stamp, in a separate frame; None where unknown."""
        path = Trajectory(np.array([row[0] for row in self._path]), tuple(row[1] for row in self._path))
        return path.at(stamp_s) if path.stamps_s[0] <= stamp_s <= path.stamps_s[-1] else None
