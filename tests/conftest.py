"""What several rooms' tests share."""

import os
import signal
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest
from hypothesis import settings

# A busy machine is no failure. The same examples each time; `make reliability` states a number and draws new ones.
ASKED = {"EDGEMAP_EXAMPLES", "EDGEMAP_FUZZ_STEPS"} & set(os.environ)
settings.register_profile("edgemap", deadline=None, derandomize=not ASKED, max_examples=100 if ASKED else 25)
settings.load_profile("edgemap")

import_module("edgemap")  # before a test imports OpenCV, which reads its limits from the environment

# Each worker keeps to its share of the cores, and so do the commands that it starts: they start a thread for each core
# that they may use, and threads that spin on cores of the other worker cost more than they bring.
if "PYTEST_XDIST_WORKER" in os.environ:
    worker, workers = int(os.environ["PYTEST_XDIST_WORKER"][2:]), int(os.environ["PYTEST_XDIST_WORKER_COUNT"])
    if hasattr(os, "sched_setaffinity"):
        cores = sorted(os.sched_getaffinity(0))
        os.sched_setaffinity(0, cores[worker::workers] or cores)
    for library in ("OMP", "OPENBLAS", "MKL"):
        os.environ.setdefault(f"{library}_NUM_THREADS", "1")

# A test run in the background of a shell script ignores Ctrl-C, and so would every command that it starts.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_collection_modifyitems(items):
    """Files with slow tests first: the last ones keep both workers busy (`--dist loadfile --no-loadscope-reorder`)."""
    slow = {item.path for item in items if item.get_closest_marker("slow")}
    items.sort(key=lambda item: item.path not in slow)


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder of real weights and pictures, $EDGEMAP_SHARED/data; the test skips where it is absent."""
    root = Path(os.environ.get("EDGEMAP_SHARED", Path(__file__).parents[2] / "shared"))
    if not (root / "data").is_dir():
        pytest.skip(f"real data not here: no folder {root / 'data'} (set EDGEMAP_SHARED)")
    return root / "data"


@pytest.fixture(scope="session")
def edgemap():
    """Runs the command line in a process of its own: edgemap("run", "--frames", "3") -> CompletedProcess."""
    from support.forked import ForkedCommands

    commands = ForkedCommands()
    yield commands
    commands.close()


@pytest.fixture
def started():
    """started("run", …) -> the command line in a process of its own, its output in a pipe; killed at the end."""
    processes = []

    def begin(*words, **options):
        command = [sys.executable, "-u", "-m", "edgemap.cli", *map(str, words)]
        processes.append(subprocess.Popen(command, **{"stdout": subprocess.PIPE, "text": True} | options))
        return processes[-1]

    yield begin
    for process in processes:
        process.kill()
        process.communicate()


@pytest.fixture(scope="session")
def browser(tmp_path_factory):
    """One chromium for all tests; skips where there is none."""
    from support.browser import Browser, find_chromium

    if find_chromium() is None:
        pytest.skip("no chromium: apt-get install chromium")
    browser = Browser(tmp_path_factory.mktemp("chromium"))
    yield browser
    browser.close()


@pytest.fixture(scope="session")
def realsense_recording(tmp_path_factory):
    """Sixty pictures of noise recorded by librealsense itself: the `.db3`, the RGB pictures, the stamps in seconds."""
    pytest.importorskip("pyrealsense2")
    import numpy as np
    from reliability.record_realsense import record_whole

    random = np.random.default_rng(5)
    pictures = [random.integers(0, 256, (480, 640, 3), dtype=np.uint8) for _ in range(60)]
    stamps = [1000.0 + i / 30 for i in range(60)]
    path = record_whole(tmp_path_factory.mktemp("realsense") / "drive.db3", pictures, stamps)
    return path, pictures, stamps


@pytest.fixture(scope="session")
def whole_demo():
    """The demo's first 200 frames, each through the backbone once."""
    from reliability.demo_slam import DemoDrive

    return DemoDrive(200)


@pytest.fixture
def demo(whole_demo):
    """The same, its camera's wheels as they were."""
    wheel = whole_demo.camera.info.wheel
    yield whole_demo
    whole_demo.camera.update_info(wheel=wheel)


@pytest.fixture(scope="session")
def floorless_bundle(tmp_path_factory):
    """A bundle that sees a chair 5 m ahead and a person, whatever the picture."""
    from support.painted import write_painted

    scene = [("chair", 40.0, 30.0, 12.0, 24.0, 0.9), ("person", 10.0, 40.0, 8.0, 20.0, 0.8)]
    return write_painted(tmp_path_factory.mktemp("painted") / "bundle", scene, odometry=False)


@pytest.fixture(scope="session")
def painted(tmp_path_factory):
    """A folder of bundles under the names of those that come along, all of which see a chair in every picture."""
    import numpy as np
    from support.painted import with_floor, write_painted

    folder = tmp_path_factory.mktemp("shipped")
    for name in ("edgemap-nano", "edgemap-pico"):
        bundle = write_painted(folder / name, [("chair", 32.0, 33.0, 14.0, 42.0, 0.9)], odometry=True)
        with_floor(bundle, np.ones((1, 1, 8, 8)), 8)
    return folder
