"""A budget does less where it must, more where there is room, says so, and what it decided can be replayed."""

import json
from dataclasses import replace

import numpy as np
import pytest
from support.made_camera import MadeCamera
from support.noise import noise
from support.odometry import MadeOdometry
from support.recordings import FACTS, drain, record

from edgemap.cli.arguments import OptionError
from edgemap.cli.run_options import read_share
from edgemap.geometry.camera.imu import ImuSamples
from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.errors import CameraFault, FaultKind
from edgemap.runtime.frames.frame import Frame
from edgemap.runtime.inputs.budget import LADDER, Budget, Effort
from edgemap.runtime.inputs.cameras.wrappers import BudgetedCamera
from edgemap.runtime.inputs.open import open_camera
from edgemap.runtime.motion.odometry.hybrid import HybridOdometry, Member
from edgemap.runtime.motion.odometry.protocol import Motion, first_motion
from edgemap.runtime.step.config import ConfigError, load_efforts


class Robot:
    """A camera of 10 Hz and a step on clocks of their own: a frame searched takes 20 ms, another one 7 ms."""

    def __init__(self, share):
        self.now_s = self.used_s = 0.0
        self.searched_s, self.plain_s = 0.020, 0.007
        self.budget = Budget(share, lambda: self.now_s, lambda: self.used_s)
        self.effort, self.index, self.told = Effort(), 0, []

    def drive(self, seconds):
        """The efforts that were decided meanwhile, and the share of a core of the last two seconds."""
        decided, start_s = [], self.now_s
        while self.now_s < start_s + seconds:
            if start_s + seconds - self.now_s > 2.0:
                used_s = self.used_s
            if found := self.budget.decide():
                self.effort = replace(found[0], since=self.index)
                decided.append((found[0].search_every, found[0].take_every))
                self.told.append(found[1])
            if self.effort.takes(self.index):
                search = self.effort.searches(self.index)
                self.budget.frame(search)
                self.used_s += self.searched_s if search else self.plain_s
            self.index, self.now_s = self.index + 1, self.now_s + 0.1
        return decided, (self.used_s - used_s) / 2.0


def test_the_search_goes_first_then_frames_and_it_settles_within_the_share():
    robot = Robot(0.10)
    decided, share = robot.drive(60.0)
    assert decided == [(2, 1), (3, 1), (5, 1)]
    assert share <= 0.105
    assert robot.told[0] == "20 % of a core, 10 allowed"
    robot = Robot(0.04)
    assert robot.drive(60.0)[0] == [(2, 1), (3, 1), (5, 1), (2, 2), (2, 3), (2, 4)]
    assert robot.drive(60.0) == ([], pytest.approx(0.034, abs=0.007))


def test_within_the_share_nothing_changes_and_where_frames_become_cheap_everything_is_done_again():
    assert Robot(0.25).drive(60.0)[0] == []
    robot = Robot(0.10)
    robot.drive(30.0)
    robot.searched_s, robot.plain_s = 0.008, 0.003
    assert robot.drive(60.0)[0] == [(3, 1), (2, 1), (1, 1)]


def test_less_than_the_last_step_cannot_be_done_and_that_is_said_once():
    robot = Robot(0.01)
    robot.drive(60.0)
    assert [text for text in robot.told if text.endswith("less than this cannot be done")] == robot.told[-1:]


@pytest.mark.parametrize(("text", "share"), [("30%", 0.3), ("0.3", 0.3), ("150%", 1.5), (None, None)])
def test_a_share_is_read(text, share):
    assert read_share(text) == share


@pytest.mark.parametrize("text", ["30", "0", "-1", "nan", "much", "1e9%"])
def test_what_is_no_share_is_refused(text):
    with pytest.raises(OptionError, match="expected a share of one core, 30% or"):
        read_share(text)


def counting(count):
    """Numbered pictures with one inertial sample each."""
    samples = ImuSamples(np.arange(count) / 10, np.zeros((count, 3)), np.zeros((count, 3)))
    return MadeCamera(count, noise, imu=samples, size=(64, 64))


REPLAYED = [Effort(4, 2, 1), Effort(8, 2, 3)]


def test_frames_are_taken_and_marked_and_no_inertial_sample_is_lost():
    camera = BudgetedCamera(counting(20), replayed=REPLAYED)
    frames = drain(camera)
    assert camera.status == ", 1 of 3 frames taken, 1 of 2 searched"
    assert [round(10 * frame.stamp_s) for frame in frames] == [0, 1, 2, 3, 4, 5, 6, 7, 8, 11, 14, 17]
    assert [frame.search for frame in frames] == [True] * 5 + [False, True, False, True, False, True, False]
    assert [frame.index for frame in frames] == list(range(12))
    assert sum(len(frame.imu) for frame in frames) == 18
    assert camera.efforts == [
        {"since": 4, "search_every": 2, "take_every": 1},
        {"since": 8, "search_every": 2, "take_every": 3},
    ]


def test_a_decision_is_told_as_news_and_no_fault():
    robot = Robot(0.10)
    camera = BudgetedCamera(counting(60), robot.budget)
    told = []
    for _ in range(60):
        try:
            camera.read()
        except CameraFault as news:
            told.append(news)
        robot.now_s, robot.used_s = robot.now_s + 0.1, robot.used_s + 0.02
    assert [(news.kind, news.counted) for news in told] == [(FaultKind.EFFORT, False)] * 2
    assert str(told[0]) == "budget: 20 % of a core, 10 allowed: every frame taken, 1 of 2 searched"


def test_decisions_come_back_from_a_run_json_and_from_a_recording(tmp_path):
    camera = BudgetedCamera(counting(20), replayed=REPLAYED)
    frames = drain(camera)
    (tmp_path / "run.json").write_text(json.dumps({"options": {}, "efforts": camera.efforts}))
    assert load_efforts(tmp_path) == load_efforts(tmp_path / "run.json") == REPLAYED
    (tmp_path / "run.json").write_text(json.dumps({"efforts": [{"since": 0, "search_every": 0, "take_every": 1}]}))
    with pytest.raises(ConfigError, match="search_every"):
        load_efforts(tmp_path)
    taped = record(tmp_path / "a.mcap", FACTS, [replace(one, image=one.image[:48]) for one in frames], lossless=True)
    with open_camera(str(taped)) as tape:
        played = drain(BudgetedCamera(tape))
    assert [(frame.index, frame.search) for frame in played] == [(frame.index, frame.search) for frame in frames]


class Ahead(MadeOdometry):
    """Says 0.1 m a frame but the first after a reset, and remembers at which frames it was asked, and after how many
    resets."""

    def __init__(self, needs_features, sigma_m):
        self.needs_features, self.asked = needs_features, []
        self._variance = sigma_m**2

    def step(self, frame, features, prior=None):
        assert features or not self.needs_features
        first = self.resets not in [resets for _, resets in self.asked]
        self.asked.append((frame.index, self.resets))
        return first_motion() if first else Motion(SE2(0.1), np.eye(3) * self._variance)


def test_who_needs_features_sleeps_until_two_frames_in_a_row_have_some():
    needy, wheels = Ahead(True, 0.001), Ahead(False, 0.05)
    hybrid = HybridOdometry([Member(needy, "camera"), Member(wheels, "wheels")])
    assert not hybrid.needs_features
    assert HybridOdometry([Member(Ahead(True, 0.1), "camera")]).needs_features
    before, motions = needy.resets, []
    for index, searched in enumerate([1, 1, 0, 1, 0, 1, 1, 1]):
        frame = Frame(index, index / 10, np.zeros((2, 2, 3), np.uint8))
        motions.append(hybrid.step(frame, {"features": np.zeros(1, np.float32)} if searched else {}))
    assert needy.asked == [(0, before), (1, before), (6, before + 1), (7, before + 1)]
    assert [motion.motion.x_m for motion in motions[1:]] == pytest.approx([0.1] * 7)
    told = [motion.covariance[0, 0] < 0.01**2 for motion in motions]
    assert told == [False, True, False, False, False, False, False, True]
    assert not any(motion.fault for motion in motions)


def test_no_step_of_the_ladder_takes_more_than_the_one_before():
    def cost(effort):
        return (7 + 13 / effort.search_every) / effort.take_every

    assert [cost(effort) for effort in LADDER] == sorted(map(cost, LADDER), reverse=True)
