import copy
import http.server
import shutil
import threading
from functools import partial
from pathlib import Path

import pytest

# A little Darknet network with one head: 32x32 input, strides 8 and 16, 1 anchor x (2 classes + 5) = 7 filters.
SMALL_CFG = """\
[net]
width=32
height=32
channels=3

[convolutional]
batch_normalize=1
filters=4
size=3
stride=2
pad=1
activation=leaky

[maxpool]
size=2
stride=2

[convolutional]
filters=8
size=3
stride=2
pad=1
activation=mish

[convolutional]
batch_normalize=1
filters=8
size=3
pad=1
groups=4
activation=swish

[shortcut]
from=-2
activation=leaky

[maxpool]
size=2
stride=1

[convolutional]
filters=7
size=1
stride=1
activation=linear

[yolo]
mask=1
anchors=4,5, 10,12
classes=2
num=2
scale_x_y=1.05
"""
# By hand: conv 3->4: 3*4*9 + 4*4 = 124; conv 4->8: 4*8*9 + 8 = 296; grouped 8->8: 2*8*9 + 4*8 = 176; 8->7: 56 + 7 = 63.
SMALL_VALUES = 124 + 296 + 176 + 63


@pytest.fixture
def small_cfg(tmp_path) -> Path:
    return write_small(tmp_path)[0]


@pytest.fixture
def small_weights(tmp_path, small_cfg) -> Path:
    return write_small(tmp_path)[1]


def write_small(folder: Path) -> tuple[Path, Path]:
    from support.darknet_file import save_weights

    from edgemap.export.darknet import Darknet
    from edgemap.export.darknet_weights import random_weights

    cfg, weights = folder / "small.cfg", folder / "small.weights"
    cfg.write_text(SMALL_CFG)
    network = Darknet(cfg)
    random_weights(network, seed=3)
    save_weights(network, weights, seen=77)
    return cfg, weights


@pytest.fixture(scope="session")
def small_files(tmp_path_factory) -> tuple[Path, Path]:
    """Cfg and weights of the small network, for what is exported once."""
    return write_small(tmp_path_factory.mktemp("files"))


@pytest.fixture(scope="session")
def exported_once(tmp_path_factory, small_files) -> Path:
    from edgemap.export.exporter import export_backbone

    cfg, weights = small_files
    return export_backbone(str(cfg), tmp_path_factory.mktemp("exported") / "small", weights=weights, feature="head")


@pytest.fixture
def small(tmp_path, exported_once) -> Path:
    """The small network's bundle, the test's own copy, alone in its folder."""
    return shutil.copytree(exported_once, tmp_path / "out" / "small")


@pytest.fixture
def brief(monkeypatch):
    """Export's own proof, kept short: test_export.py is about it."""
    from edgemap.export import parity

    monkeypatch.setattr(parity, "CASES", 1)
    monkeypatch.setattr(parity, "STEPS", 2)


@pytest.fixture(scope="session")
def graphs():
    """ONNX graphs that `traced_once` has made."""
    return {}


@pytest.fixture
def traced_once(monkeypatch, graphs):
    """Each Darknet network with each contract is traced once, which takes seconds: for tests of what comes after."""
    from edgemap.export import backbones

    trace = backbones.backbone_to_onnx

    def traced(network, detector):
        key = repr(detector), float(sum(parameter.abs().sum() for parameter in network.parameters()))
        if key not in graphs:
            graphs[key] = trace(network, detector)
        return copy.deepcopy(graphs[key])

    monkeypatch.setattr(backbones, "backbone_to_onnx", traced)


@pytest.fixture
def cache(tmp_path, monkeypatch) -> Path:
    monkeypatch.setenv("EDGEMAP_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache"


class Handler(http.server.BaseHTTPRequestHandler):
    """Serves `server.files`; `server.cut` bytes end a reply early."""

    protocol_version = "HTTP/1.0"
    server: "FileServer"  # type: ignore[assignment]

    def do_GET(self):
        server = self.server
        server.asked.append(self.path)
        if self.path in server.slow:
            server.release.wait(5)
        elif self.path not in server.files:
            self.send_error(404)
        else:
            data = server.files[self.path]
            self.send_response(200)
            self.send_header("Content-Length", str(len(data)))
            self.end_headers()
            self.wfile.write(data[: server.cut])

    def log_message(self, *arguments):
        pass


class FileServer(http.server.ThreadingHTTPServer):
    """A local web server. files: path to bytes; slow: paths that get no answer; asked: paths that were asked for."""

    daemon_threads = True

    def __init__(self):
        super().__init__(("127.0.0.1", 0), Handler)
        self.files: dict[str, bytes] = {}
        self.asked: list[str] = []
        self.slow: set[str] = set()
        self.cut: int | None = None
        self.release = threading.Event()

    def url(self, path: str) -> str:
        return f"http://127.0.0.1:{self.server_address[1]}{path}"


@pytest.fixture
def server():
    server = FileServer()
    threading.Thread(target=partial(server.serve_forever, poll_interval=0.01), daemon=True).start()
    yield server
    server.release.set()
    server.shutdown()
    server.server_close()
