"""Programs built against Fast DDS, as ROS 2's default is, read what edgemap publishes and publish what it reads.

Debian's Fast DDS stands for ROS 2: names, types and QoS as rmw_fastrtps has them, CDR by Fast CDR (fastdds_peer.cpp).
"""

import json
import math
import os
import shutil
import signal
import subprocess
import sys
import time
import zlib
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import cv2
import numpy as np
import pytest
from support.recordings import LENS, MOUNT
from support.results import CHAIR, COVARIANCE, OFF, POSES, results, run_info

from edgemap.geometry.camera.imu import ImuSamples
from edgemap.geometry.camera.intrinsics import Intrinsics
from edgemap.geometry.map_object import radius_m
from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.frame import Frame

pytest.importorskip("cyclonedds", reason="cyclonedds is not installed (extra 'ros2')")
from edgemap.bridges.ros2.dds.camera import Ros2Camera, Ros2SensorsCamera, Ros2Topic
from edgemap.bridges.ros2.dds.depth import DepthTopic
from edgemap.bridges.ros2.dds.discovery import Discovery
from edgemap.bridges.ros2.dds.node import Node, Publisher, Reliability, Subscription, wait_for
from edgemap.bridges.ros2.dds.sources import WheelTopic
from edgemap.bridges.ros2.messages import build
from edgemap.bridges.ros2.recordings.recorder import Recorder
from edgemap.bridges.ros2.sink import Ros2Options, Ros2Sink
from edgemap.runtime.frames.camera import NO_DEPTH, CameraInfo, CameraOptions, SensorTopics, next_frame
from edgemap.runtime.frames.errors import CameraError
from edgemap.runtime.inputs.open import open_camera
from edgemap.runtime.motion.odometry.recorded import RecordedOdometry

pytestmark = pytest.mark.slow
SOURCE = Path(__file__).with_name("fastdds_peer.cpp")
DOMAIN = 1 + os.getpid() % 100  # runs beside this one have their own


@pytest.fixture(scope="session")
def program(request) -> Path:
    """The peer, compiled once for each version of its source."""
    if shutil.which("g++") is None:
        pytest.skip("no g++")
    if not Path("/usr/include/fastdds").is_dir():
        pytest.skip("no Fast DDS (apt-get install libfastrtps-dev libfastcdr-dev)")
    folder = request.config.cache.mkdir("fastdds_peer")
    built = folder / f"{zlib.crc32(SOURCE.read_bytes()):08x}"
    if not built.exists():
        fresh = folder / f"{built.name}.{os.getpid()}"
        subprocess.run(["g++", "-std=c++17", "-o", fresh, SOURCE, "-lfastrtps", "-lfastcdr"], check=True)
        fresh.rename(built)
    return built


@pytest.fixture(scope="module")
def node() -> Node:
    return Node(Discovery(DOMAIN))


class Peer:
    """The program at work: `subscribe` or `publish` with topics as it takes them."""

    def __init__(self, program: Path, what: str, *topics: str, seconds: float = 60.0) -> None:
        environment = os.environ | {"ROS_DOMAIN_ID": str(DOMAIN)}
        command = [program, what, str(seconds), *topics]
        self._process = subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, text=True)

    @property
    def running(self) -> bool:
        return self._process.poll() is None

    def heard(self) -> dict[str, list[dict]]:
        """All messages by topic, once the program has ended by itself."""
        lines, _ = self._process.communicate(timeout=60.0)
        assert self._process.returncode == 0, f"some are missing: {lines}"
        found: dict[str, list[dict]] = {}
        for line in lines.splitlines():
            message = json.loads(line)
            found.setdefault(message["topic"], []).append(message)
        return found

    def __enter__(self) -> "Peer":
        return self

    def __exit__(self, *_) -> None:
        self._process.kill()
        self._process.communicate()


def fnv1a(data: bytes) -> str:
    value = 1469598103934665603
    for byte in data:
        value = ((value ^ byte) * 1099511628211) & 0xFFFFFFFFFFFFFFFF
    return f"{value:016x}"


def test_fast_dds_reads_what_a_run_publishes(program, node):
    """Fields of tf, odometry, a picture of 300 kB, and a map that a late reader gets, through the sink of `--ros2`."""
    picture = np.random.default_rng(3).integers(0, 256, (540, 720, 3), dtype=np.uint8)
    frames = [Frame(i, 1.7e9 + i / 10, picture) for i in range(12)]
    steps = list(results(frames, POSES))
    sink = Ros2Sink(node, run_info(), Ros2Options("robot1", pictures=True))
    wanted = (
        "rt/tf,TFMessage,reliable,3", "rt/robot1/odometry,Odometry,reliable,3",
        "rt/robot1/camera/image/compressed,CompressedImage,reliable,2",
    )  # fmt: skip
    sent = 0
    with Peer(program, "subscribe", *wanted) as peer:
        while peer.running:
            sink.write(steps[sent % 12], [CHAIR])
            sent += 1
            time.sleep(0.05)
        heard = peer.heard()
    latched = ("rt/robot1/map/objects,Detection3DArray,latched,1", "rt/robot1/map/grid,OccupancyGrid,latched,1")
    with Peer(program, "subscribe", *latched, "rt/tf_static,TFMessage,latched,1") as late:
        heard |= late.heard()

    for message in heard["rt/robot1/odometry"]:
        index = round((message["stamp_ns"] / 1e9 - 1.7e9) * 10)
        expected = OFF @ POSES[index]
        assert (message["frame"], message["child"]) == ("odom", "base_link")
        assert message["at"] == [expected.x_m, expected.y_m, 0.0]
        assert 2.0 * math.atan2(message["q"][2], message["q"][3]) == pytest.approx(expected.yaw_rad)
        assert message["covariance"][0] == 2.0 * COVARIANCE[0, 0]
        assert message["covariance"][35] == 2.0 * COVARIANCE[2, 2]
        assert message["linear"] == pytest.approx([1.0 if index else 0.0, 0.0, 0.0], abs=1e-5)
    for message in heard["rt/tf"]:
        links = {(step["frame"], step["child"]): step for step in message["transforms"]}
        index = round((message["transforms"][0]["stamp_ns"] / 1e9 - 1.7e9) * 10)
        chain = SE2()
        for link in (("map", "odom"), ("odom", "base_link")):
            (x_m, y_m, _), (_, _, sine, cosine) = links[link]["at"], links[link]["q"]
            chain = chain @ SE2(x_m, y_m, 2.0 * math.atan2(sine, cosine))
        assert chain.vector() == pytest.approx(POSES[index].vector(), abs=1e-9)
    _, encoded = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, 90])
    assert len(encoded) > 300_000
    for message in heard["rt/robot1/camera/image/compressed"]:
        assert (message["format"], message["frame"]) == ("jpeg", "camera_optical_frame")
        assert (message["bytes"], message["fnv1a"]) == (len(encoded), fnv1a(encoded.tobytes()))
    (chair,) = heard["rt/robot1/map/objects"][0]["objects"]
    assert (chair["id"], chair["label"], chair["score"]) == ("chair-1", "chair", 0.97)
    assert chair["at"] == [2.0, -1.0, 0.45]
    assert (chair["size"], chair["covariance"][:2]) == ([0.5, 0.5, 0.9], [0.04, 0.01])
    grid = heard["rt/robot1/map/grid"][0]
    cells = np.array(grid["occupied"])
    centres_m = np.array(grid["origin"][:2]) + (cells + 0.5) * grid["resolution"]
    assert (grid["frame"], grid["resolution"]) == ("map", pytest.approx(0.05))
    assert centres_m.mean(axis=0) == pytest.approx([2.0, -1.0], abs=0.03)  # Nav2 reads row 0 as the least y
    assert len(cells) * 0.05**2 == pytest.approx(math.pi * radius_m(CHAIR) ** 2, rel=0.1)
    assert grid["free"] > 0
    assert grid["free"] + grid["unknown"] + len(cells) == grid["width"] * grid["height"]
    (mount,) = heard["rt/tf_static"][0]["transforms"]
    assert (mount["frame"], mount["child"]) == ("base_link", "camera_optical_frame")
    assert mount["at"] == pytest.approx(MOUNT.position_base_m().tolist())


def test_the_command_publishes_while_it_runs(program, tmp_path):
    """`edgemap run --ros2` as typed; its process is found by the environment alone."""
    command = [sys.executable, "-m", "edgemap.cli", "run", "--frames", "30", "--ros2", "namespace=kitchen"]
    environment = os.environ | {"ROS_DOMAIN_ID": str(DOMAIN)}
    wanted = ("rt/tf,TFMessage,reliable,3", "rt/kitchen/odometry,Odometry,reliable,3")
    wanted += ("rt/kitchen/map/objects,Detection3DArray,latched,1",)
    with Peer(program, "subscribe", *wanted, seconds=60.0) as peer:
        subprocess.run([*command, "--out", tmp_path / "run"], env=environment, check=True, capture_output=True)
        heard = peer.heard()
    record = json.loads((tmp_path / "run" / "run.json").read_text())
    assert (record["frames"], record["fault_count"]) == (30, 0)
    stamps_s = [message["stamp_ns"] / 1e9 for message in heard["rt/kitchen/odometry"]]
    assert np.diff(stamps_s) == pytest.approx(0.1, abs=1e-3)  # the demo's own
    assert abs(stamps_s[0] - time.time()) < 60.0  # ROS time, whatever the demo's stamps
    assert {step["frame"] for step in heard["rt/tf"][0]["transforms"]} == {"map", "odom"}


def test_a_late_reader_gets_a_picture_of_300_kb_from_fast_dds(program, node, tmp_path):
    picture, kind = np.random.default_rng(4).integers(0, 256, (540, 720, 3), dtype=np.uint8), "CompressedImage"
    jpeg = tmp_path / "a.jpg"
    assert cv2.imwrite(str(jpeg), picture)
    with Peer(program, "publish", f"rt/in/picture,{kind},latched,1,{jpeg}"):
        assert wait_for(lambda: node.published().get("/in/picture"), 30.0) == f"sensor_msgs/msg/{kind}"
        time.sleep(0.3)  # the picture is out by now
        reader = Subscription(node, "/in/picture", f"sensor_msgs/msg/{kind}", Reliability.LATCHED)
        assert reader.wait(30.0)
        (message,) = reader.take()
    assert bytes(message.data) == jpeg.read_bytes()


def test_a_camera_with_wheels_and_imu_comes_from_topics(program, node, monkeypatch):
    """Padded rows, lens from CameraInfo, mount and the IMU's axes from tf, wheels between their stamps."""
    monkeypatch.setattr("edgemap.bridges.ros2.dds.camera.WAIT_S", 30.0)  # whatever else the machine does
    wanted = (
        "rt/front/image_raw,Image,reliable,1000",
        "rt/front/camera_info,CameraInfo,reliable,1000",
        "rt/odom,Odometry,reliable,1000",
        "rt/imu,Imu,reliable,1000",
        "rt/tf_static,TFMessage,latched,1",
    )
    with Peer(program, "publish", *wanted, seconds=60.0), Ros2Camera(node, "/front/image_raw") as pictures:
        assert pictures.info.intrinsics == Intrinsics(64, 48, 58.25, 58.5, 31.5, 23.5)
        assert (pictures.info.mount.height_m, pictures.info.mount.forward_m) == pytest.approx((0.6, 0.1))
        assert pictures.info.mount.pitch_rad == pytest.approx(0.0, abs=1e-9)
        camera = Ros2SensorsCamera(pictures, node, SensorTopics("/odom", "/imu"))
        assert isinstance(camera.info.wheel, WheelTopic)
        odometry = RecordedOdometry(camera.info.wheel, "wheels")
        moved, frames = [], []
        while len(frames) < 8:
            frame = next_frame(camera, lambda fault: pytest.fail(str(fault)))
            frames.append(frame)
            moved.append(odometry.step(frame, {}))
    for frame in frames:
        at = round((frame.stamp_s - 100.0) * 20)
        np.testing.assert_array_equal(frame.image[5, 7], [at % 256, 25, 28])  # BGR of (4 x, 5 y, ticks)
    steps = np.diff([frame.stamp_s for frame in frames[-5:]])
    for step_s, motion in zip(steps, moved[-4:], strict=True):
        # 0.01 m along x and -0.005 m along y for each 50 ms, seen from a robot turned by 0.1 rad
        expected = SE2(0.0, 0.0, 0.1).inverse() @ SE2(0.2 * step_s, -0.1 * step_s, 0.0)
        assert (motion.motion.x_m, motion.motion.y_m) == pytest.approx((expected.x_m, expected.y_m), abs=1e-6)
        assert not motion.faults
    samples = ImuSamples.joined([frame.imu for frame in frames])
    assert len(samples) > 3
    ticks = (samples.stamps_s - 100.0) * 20
    expected_gyro = np.column_stack([np.full(len(ticks), -0.02), -0.1 * ticks, np.full(len(ticks), 0.01)])
    np.testing.assert_allclose(samples.gyro_rad_s, expected_gyro, atol=1e-6)
    np.testing.assert_allclose(samples.accel_m_s2, [[-0.2, -9.81, 0.1]] * len(samples), atol=1e-9)


def test_a_run_follows_the_tf_of_a_slam_and_its_correction(program, started, tmp_path):
    """In the SLAM's map frame; a jump of 0.5 m to the left is spread over the path before it."""
    corrects, path = tmp_path / "corrects", tmp_path / "run" / "trajectory.tum"
    wanted = [f"rt/front/{topic},reliable,10000" for topic in ("image_raw,Image", "camera_info,CameraInfo")]
    wanted += [f"rt/tf,TFMessage,reliable,10000,{corrects}", "rt/tf_static,TFMessage,latched,1"]
    command = ("run", "--camera", "ros2:/front/image_raw", "--mount", "0.6", "--odometry", "tf", "--out", path.parent)
    environment = os.environ | {"ROS_DOMAIN_ID": str(DOMAIN)}
    with Peer(program, "publish", *wanted, seconds=400.0):
        run = started(*command, env=environment, stdout=None)
        for rows in (40, 80):  # on a busy machine too
            until_s = time.monotonic() + 200.0
            while not path.exists() or len(path.read_text().splitlines()) < rows:
                assert time.monotonic() < until_s
                time.sleep(0.1)
            corrects.touch()
        run.send_signal(signal.SIGINT)
        assert run.wait(60.0) == 0
    stamp_s, x_m, y_m = np.loadtxt(path)[:, :3].T
    assert x_m == pytest.approx(3.0 + 0.05 * (stamp_s - 100.0) * 20, abs=0.002)
    assert y_m[-10:] == pytest.approx(0.5, abs=1e-6)
    before = y_m < 0.499
    assert before.sum() > 30
    assert y_m[0] == 0.0
    share = (x_m[before] - x_m[0]) / (x_m[~before][0] - x_m[0])
    assert y_m[before] == pytest.approx(0.5 * share, abs=0.1)  # keyframes move as one piece with what follows them


def frames_with_depth(program, node, monkeypatch, depth, asked=None, count=3, most=100):
    """Frames of a camera beside whose pictures these topics are published, until so many have brought depth."""
    for wait, limit_s in (("camera.WAIT_S", 30.0), ("depth.LATE_S", 0.3)):
        monkeypatch.setattr(f"edgemap.bridges.ros2.dds.{wait}", limit_s)
    wanted = ("rt/front/image_raw,Image,reliable,1000", "rt/front/camera_info,CameraInfo,reliable,1000", *depth)
    how, frames = CameraOptions(topics=SensorTopics(depth=asked)), []
    with Peer(program, "publish", *wanted), Ros2Camera(node, "/front/image_raw", how) as camera:
        while len(frames) < most and sum(frame.depth is not None for frame in frames) < count:
            frames.append(next_frame(camera, lambda fault: pytest.fail(str(fault))))
    return frames


def test_depth_comes_from_a_topic_and_is_replayed_to_the_bit(program, node, monkeypatch, tmp_path):
    beside = "rt/front/aligned_depth_to_color"
    depth = (f"{beside}/image_raw,Image,reliable,1000,16UC1", f"{beside}/camera_info,CameraInfo,reliable,1000")
    frames = frames_with_depth(program, node, monkeypatch, depth)
    found = [frame for frame in frames if frame.depth is not None]
    assert len(found) == 3
    for frame in found:
        at = round((frame.stamp_s - 100.0) * 20)
        assert frame.depth[5, 7] == np.float32((1000 + 2 * 7 + 5 * 5 + at % 100) / 1000.0)
    path = tmp_path / "a.mcap"
    recorder = Recorder(path, CameraInfo("ros2:/front/image_raw", intrinsics=LENS, mount=MOUNT), lossless=True)
    for frame in frames:
        recorder.picture(frame)
    recorder.close()
    with open_camera(str(path)) as camera:
        for frame in frames:
            again = camera.read()
            assert (again.depth is None) == (frame.depth is None)
            if frame.depth is not None:
                np.testing.assert_array_equal(again.depth, frame.depth)


def test_depth_in_metres_from_a_topic_that_is_named_has_no_unknown_values(program, node, monkeypatch):
    topic = ("rt/registered/depth,Image,reliable,1000,32FC1",)
    frames = frames_with_depth(program, node, monkeypatch, topic, "/registered/depth", 1)
    depth = frames[-1].depth
    np.testing.assert_array_equal(depth[0], np.float32(1.0) + np.float32(0.5) * np.arange(64, dtype=np.float32))
    assert not depth[1:].any()  # -99 m and less


@pytest.mark.parametrize("depth", [(), ("rt/other/depth,Image,reliable,1000",)])
def test_pictures_come_without_depth_that_is_missing_or_none(program, node, monkeypatch, depth):
    frames = frames_with_depth(program, node, monkeypatch, depth, "/other/depth", most=5)
    assert len(frames) == 5
    assert all(frame.depth is None for frame in frames)
    why = NO_DEPTH if depth else "/other/depth is not published, no depth"
    assert DepthTopic(node, "/other/depth").at(0.0, None) == why


def test_grey_levels_of_16_bits_keep_one_scale(node):
    """A dark picture after a bright one is dark: the used bits are those of the camera."""
    publisher, topic = Publisher(node, "/deep/image_raw", "sensor_msgs/msg/Image"), Ros2Topic(node, "/deep/image_raw")

    def published(level, taken):
        image = {"height": 4, "width": 4, "step": 8, "encoding": "mono16", "data": np.full(16, level, "<u2").tobytes()}
        while not taken():
            publisher.write({"header": build.header(10**9, "lens")} | image)
            time.sleep(0.02)

    with ThreadPoolExecutor(1) as pool:
        opening = pool.submit(topic.open)
        published(4000, opening.done)
        assert opening.result().grab().image.max() == 4000 >> 4
        shown = []
        published(400, lambda: shown.append(topic.grab()) or (shown[-1] and shown[-1].image.max() < 250))
    assert shown[-1].image.max() == 400 >> 4
    topic.close()


def test_a_topic_that_nobody_publishes_is_one_line(node, monkeypatch):
    monkeypatch.setattr("edgemap.bridges.ros2.dds.camera.WAIT_S", 0.1)
    with pytest.raises(CameraError, match=r"nobody publishes /nothing/here within 0 s \(topics with pictures: "):
        Ros2Camera(node, "/nothing/here")
