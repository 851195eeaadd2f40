"""What comes over a network or is typed: requests to the live page, its viewers' messages, the answers of a server that
`pull URL` asks, and the texts of options; valid ones, mutated."""

import asyncio
import json
import os
import shutil
import socket
import threading
from collections.abc import Callable
from copy import deepcopy
from importlib import import_module
from pathlib import Path
from random import Random
from typing import Any

import msgspec
import numpy as np

from edgemap.geometry.errors import EdgemapError
from edgemap.runtime.frames.frame import Frame
from edgemap.runtime.frames.reading import printable
from edgemap.runtime.inputs.cameras.webcam import StreamDriver
from edgemap.runtime.inputs.cameras.wheels import read_wheels
from edgemap.runtime.inputs.drives import open_drive
from edgemap.runtime.inputs.open import open_camera
from edgemap.runtime.network import store
from edgemap.runtime.network.download import download
from edgemap.runtime.network.web import is_url
from edgemap.runtime.step.mapper import Mapper
from edgemap.view.app import make_app
from edgemap.view.page import LivePage
from edgemap.view.pause import Pause
from reliability.demo_slam import DemoDrive
from reliability.mutations import NUMBERS, json_bytes, mutated_bytes
from reliability.tiny_bundle import write_tiny
from reliability.workers import ReaderCase

TOKEN, COOKIE = "t0ken-t0ken-t0ken", "edgemap-1"
READ = (
    "/", "/index.html", "/main.js", "/api/run", "/api/health", "/api/faults", "/api/pose", "/api/frame", "/api/picture", "/api/map",
    "/api/objects", "/api/objects/{seen}/picture", "/api/openapi.yaml", "/api/rooms", "/api/events",
)  # fmt: skip
CORNERS = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]]
WRITTEN: tuple[tuple[str, str, Any], ...] = (
    ("PATCH", "/api/objects/{seen}", {"name": "mine", "confirmed": True, "x_m": 1.0, "y_m": 0.5}),
    ("POST", "/api/objects", {"label": "chair", "x_m": 1.0, "y_m": 0.5, "width_m": 0.5}),
    ("POST", "/api/objects/{seen}/merge", {"into": "chair-1"}),
    ("DELETE", "/api/objects/{seen}", {}),
    ("POST", "/api/objects/chair-1/restore", {}),
    ("POST", "/api/zones", {"name": "desk", "corners_m": CORNERS}),
    ("PUT", "/api/zones/zone-1", {"name": "desk", "corners_m": CORNERS}),
    ("POST", "/api/pause", {"paused": True}),
    ("POST", "/api/save", {}),
)
HEADERS = {
    "host": "127.0.0.1:8090", "authorization": f"Bearer {TOKEN}", "cookie": f"{COOKIE}={TOKEN}",
    "origin": "http://127.0.0.1:8090", "content-type": "application/json", "content-length": "2",
}  # fmt: skip
ODD_HEADERS = (
    "evil.example", "[::1", "null", "http://[", "https://evil.example", "text/plain", "Bearer", "-1", "9" * 30, "=;=;=",
    "é=é; " * 1000, f'{COOKIE}="' + "\\" * 60_000 + '"', "",
)  # fmt: skip
ODD_PATHS = ("/../page.py", "//", "/api/objects/" + "%00" * 50, "/api/objects/\x1b", "/\udcff", "/" * 500, "", "*")


class _PageRefusal(EdgemapError):
    """An answer of the page that is no success."""


def page_cases(scratch: Path) -> list[ReaderCase]:
    """scratch: for the page's folder and a bundle to be pulled."""
    page, mapper = _page(scratch / "page")
    answers = _valid_answers(scratch / "pulled")
    return [
        ReaderCase("option texts", _option, _use_option),
        ReaderCase("page, requests", _request, lambda _, drawn: _use_request(page, mapper, drawn)),
        ReaderCase("page, viewers", _talk, lambda _, drawn: _use_talk(page, drawn)),
        ReaderCase("pull, a server's answers", lambda random: _answers(random, answers), _Server().use),
    ]


def _page(folder: Path) -> tuple[LivePage, Mapper]:
    """A page in the middle of the demo, its map saved into a folder."""
    folder.mkdir()
    page = LivePage({"camera": "demo", "live": False, "rate_hz": 10.0, "marks": {}}, folder, Pause())
    demo = DemoDrive(12)
    slam = demo.slam("truth")
    for index, (image, stamp_s) in enumerate(zip(demo.images, demo.stamps_s, strict=True)):
        page.write(slam.step(Frame(index, stamp_s, image)), slam.mapper.objects())
    return page, slam.mapper


# Requests, as a server hands them to the application.


def _headers(random: Random) -> list[tuple[bytes, bytes]]:
    found = [(name, value) for name, value in HEADERS.items() if random.random() < 0.7]
    for number, (name, value) in enumerate(found):
        if random.random() < 0.1:
            changed = mutated_bytes(random, value.encode()).decode("latin-1")
            found[number] = name, random.choice((changed, *ODD_HEADERS))
    if random.random() < 0.05:
        found.append(random.choice((("host", "evil.example"), ("x" * 300, "y" * 9000), ("range", "bytes=9-1"))))
    return [(name.encode(), value.encode("latin-1", "replace")) for name, value in found]


def _request(random: Random) -> dict[str, Any]:
    method, path, body = random.choice((random.choice(WRITTEN), ("GET", random.choice(READ), {})))
    data = json_bytes(random, body) if random.random() < 0.5 else json.dumps(body).encode()
    query = random.choice((b"", f"token={TOKEN}".encode()))
    if random.random() < 0.1:
        method = random.choice(("GET", "POST", "HEAD", "OPTIONS", "get", "", "X" * 99))
    if random.random() < 0.1:
        path = random.choice((*ODD_PATHS, mutated_bytes(random, path.encode()).decode("latin-1")))
    if random.random() < 0.05:
        query = random.choice((b"token=", b"token=%ff", b"&" * 9000, b"token=a&token=b", mutated_bytes(random, query)))
    if random.random() < 0.05:
        data = random.choice((b"[" * 9000, b"x" * 20_000, b"\xff", b""))
    pieces = [data] if random.random() < 0.7 else [data[:3], data[3:]]
    messages = [{"type": "http.request", "body": piece, "more_body": piece is not pieces[-1]} for piece in pieces]
    if random.random() < 0.05:
        messages[-1] = {"type": "http.disconnect"}
    headers, token = _headers(random), random.random() < 0.7
    return {"path": path, "query": query, "method": method, "headers": headers, "messages": messages, "token": token}


def _use_request(page: LivePage, mapper: Mapper, drawn: dict[str, Any]) -> None:
    """One request, in a run that takes edits meanwhile; the map is as it was for the next one."""
    newest, mapper = page.newest, deepcopy(mapper)
    path = drawn["path"].replace("{seen}", page.objects[0].id)
    scope = {
        "type": "http", "asgi": {"version": "3.0"}, "http_version": "1.1", "method": drawn["method"], "path": path,
        "root_path": "", "raw_path": path.encode("utf-8", "surrogateescape"), "query_string": drawn["query"],
        "headers": drawn["headers"], "scheme": "http", "client": ("10.0.0.1", 5), "server": ("127.0.0.1", 8090),
    }  # fmt: skip
    token = TOKEN if drawn["token"] else ""
    sent = asyncio.run(_served(page, scope, drawn["messages"], token, lambda: page.edits.apply(mapper, 12)))
    page.newest = newest
    assert [message["type"] for message in sent[:1]] == ["http.response.start"]
    status, headers = sent[0]["status"], dict(sent[0]["headers"])
    body = b"".join(message.get("body", b"") for message in sent[1:])
    assert status < 500 or status == 503, (status, body[:100])
    assert not any(b"\n" in value or b"\r" in value for value in headers.values())
    if token and status == 200:
        brought = b" ".join(value for _, value in drawn["headers"]) + drawn["query"]
        assert TOKEN.encode() in brought, "an answer without the token"
    if status >= 400:
        raise _PageRefusal(f"{status} {body.decode('utf-8', 'replace').strip()[:60]!a}")


async def _served(
    page: LivePage, scope: dict[str, Any], messages: list[dict[str, Any]], token: str, step: Callable[[], object] = list
) -> list[Any]:
    """What the application sends for these messages. step: what the run does meanwhile."""
    waiting, sent = list(messages), []

    async def receive() -> Any:
        return (
            waiting.pop(0)
            if waiting
            else {"type": "websocket.disconnect" if scope["type"] == "websocket" else "http.disconnect", "code": 1001}
        )

    async def send(message: Any) -> None:
        sent.append(message)

    async def drive() -> None:
        while True:
            step()
            await asyncio.sleep(0.0005)

    run = asyncio.create_task(drive())
    try:
        await asyncio.wait_for(make_app(page, token, COOKIE)(scope, receive, send), 5.0)
    finally:
        run.cancel()
    return sent


def _talk(random: Random) -> dict[str, Any]:
    said: list[dict[str, Any]] = []
    for _ in range(random.randrange(9)):
        data = json_bytes(random, {"do": random.choice(("shown", "stream", "sightings")), "on": True})
        said.append({"type": "websocket.receive", "text": data.decode("utf-8", "replace")})
        if random.random() < 0.1:
            said[-1] = random.choice((
                {"type": "websocket.receive", "bytes": data}, {"type": "websocket.receive", "text": "[" * 4000},
                {"type": "websocket.receive", "text": None, "bytes": b"\xff"}, {"type": "websocket.disconnect", "code": 1006},
            ))  # fmt: skip
    return {"headers": _headers(random), "said": said, "token": random.random() < 0.3}


def _use_talk(page: LivePage, drawn: dict[str, Any]) -> None:
    scope = {
        "type": "websocket", "asgi": {"version": "3.0"}, "http_version": "1.1", "path": "/api/stream", "raw_path": b"/api/stream", "root_path": "",
        "query_string": b"", "headers": drawn["headers"], "scheme": "ws", "client": ("10.0.0.1", 5), "server": ("127.0.0.1", 8090), "subprotocols": [],
    }  # fmt: skip
    messages = [{"type": "websocket.connect"}, *drawn["said"]]
    sent = asyncio.run(_served(page, scope, messages, TOKEN if drawn["token"] else ""))
    kinds = [message["type"] for message in sent]
    assert set(kinds) <= {"websocket.accept", "websocket.send", "websocket.close"}
    for message in sent:
        if message["type"] == "websocket.send" and message.get("text"):
            msgspec.json.decode(message["text"])
    if "websocket.accept" not in kinds:
        raise _PageRefusal("not let in")
    if "websocket.close" in kinds:
        raise _PageRefusal(f"shown out ({sent[-1].get('code')})")


# A server that answers as it likes.


def _valid_answers(folder: Path) -> list[bytes]:
    """Raw answers to one request after the other: bundle.json, then its file."""
    write_tiny(folder)
    bodies = [(folder / name).read_bytes() for name in ("bundle.json", "backbone.onnx")]
    return [b"HTTP/1.1 200 OK\r\nContent-Length: %d\r\nETag: x\r\n\r\n" % len(body) + body for body in bodies]


def _answers(random: Random, valid: list[bytes]) -> list[bytes]:
    """Answers with a mutated bundle.json, header or body; redirects on the way."""
    answers = list(valid)
    chosen, roll = random.randrange(len(answers)), random.random()
    head, _, body = answers[chosen].partition(b"\r\n\r\n")
    if roll < 0.3 and chosen == 0:
        body = json_bytes(random, json.loads(body))
        head = b"HTTP/1.1 200 OK\r\nContent-Length: %d" % len(body)
    elif roll < 0.6:
        lines = head.split(b"\r\n")
        changed = random.randrange(len(lines))
        lines[changed] = random.choice((
            mutated_bytes(random, lines[changed]), b"HTTP/1.1 206 Partial", b"HTTP/1.1 100 Continue", b"HTTP/9.9 200", b"x",
            b"Content-Length: " + random.choice(NUMBERS).encode(), b"Transfer-Encoding: chunked", b"a: b\r\n" * 200 + b"c: d",
            b"Content-Range: bytes 0-0/" + b"9" * 30, b"y: " + b"z" * 70_000, b" folded", b"Content-Encoding: gzip",
        ))  # fmt: skip
        head = b"\r\n".join(lines)
    elif roll < 0.8:
        place = random.choice(
            (b"file:///etc/passwd", b"ftp://x/", b"http://[", b"//x", b"", b"\x1b", b"data:,x", b"/again")
        )
        answers.insert(chosen, b"HTTP/1.1 302 x\r\nLocation: " + place + b"\r\nContent-Length: 0\r\n\r\n")
        return answers
    else:
        body = mutated_bytes(random, body)
    answers[chosen] = head + b"\r\n\r\n" + body
    return answers


class _Server:
    """A thread that gives the answers one connection after the other."""

    def __init__(self) -> None:
        self._socket: socket.socket | None = None
        self._answers: list[bytes] = []

    def use(self, folder: Path, answers: list[bytes]) -> None:
        """Fetch one file, then a whole bundle."""
        if self._socket is None:  # in the worker, behind the fork
            self._socket = socket.create_server(("127.0.0.1", 0))
            threading.Thread(target=self._serve, daemon=True).start()
        base = f"http://127.0.0.1:{self._socket.getsockname()[1]}"
        cache, outside = folder / "cache", set(folder.iterdir())
        shutil.rmtree(cache, ignore_errors=True)
        os.environ["EDGEMAP_CACHE"] = str(cache)
        self._answers = list(answers)
        tries: tuple[Callable[[], object], ...] = (
            lambda: download(
                f"{base}/a", folder / "one", maximum_bytes=1 << 20, longest_s=5.0, timeout_s=2.0, progress=False
            ),
            lambda: store.install_url(f"{base}/tiny", progress=False),
        )
        try:
            for attempt in tries:
                attempt()
                self._answers = list(answers)
        finally:
            (folder / "one").unlink(missing_ok=True)
            for path in (folder / "one.part", folder / "one.part.json"):
                path.unlink(missing_ok=True)
            assert set(folder.iterdir()) <= outside | {cache}, "a file beside the cache"
        assert len(list((cache / "bundles").glob("*/bundle.json"))) == 1

    def _serve(self) -> None:
        assert self._socket is not None
        while True:
            connection, _ = self._socket.accept()
            try:
                connection.settimeout(2.0)
                connection.recv(65536)
                if self._answers:
                    connection.sendall(self._answers.pop(0))
            except OSError:
                pass
            finally:
                connection.close()


# What is typed.

OPTIONS = {
    "--mount": "0.6,11.5", "--intrinsics": "587,587,319.5,239.5", "--start": "1,2,90", "--near": "1,2", "--classes": "chair,bed",
    "--inside": "0,0;1,0;1,1", "--board": "9x6", "--mqtt": "localhost:1883", "sim": "sim:9000", "url": "http://127.0.0.1/x",
}  # fmt: skip
SPEC_PARTS = (
    "demo", "realsense:/x.bag", "kitti:", "tum:", "c2w:", "drive:", "euroc:", "locobot:", "yolo:", "sim:",
    ".", "..", "/", "/dev/null", "/dev/zero", "/dev/video", "/dev/stdin", "/proc/self/mem", "/proc/self/environ", "~", "~root", "~nobody-here",
    ".mcap", "a.mcap", "#/topic", "#", ":", "//", "0", "9", "99", "١", "²", "%d", "%03d.png", "a" * 300, "a" * 5000, "\udcff", "\n",
    "\x1b[2J", "\0", " ", "-", "--", "concat:", "file:", "pipe:0", ".mp4", ".bag", "?x=1", "é", "[", "]", "@", "x",
)  # fmt: skip


def _option(random: Random) -> tuple[str, str]:
    option = random.choice((*OPTIONS, "camera", "data", "bundle", "wheel"))
    if option not in OPTIONS:
        return option, "".join(random.choice(SPEC_PARTS) for _ in range(random.choice((1, 1, 2, 2, 3, 5))))
    text = OPTIONS[option]
    if random.random() < 0.5:
        return option, mutated_bytes(random, text.encode()).decode("utf-8", "surrogateescape")
    for _ in range(random.randrange(3)):
        text = text.replace(random.choice(text), random.choice(NUMBERS), 1)
    return option, text


def _use_option(folder: Path, drawn: tuple[str, str]) -> None:
    del folder
    option, text = drawn
    try:
        _use_text(option, text)
    except (OSError, EdgemapError) as error:  # the command line prints both so
        raise EdgemapError(printable(str(error))) from None


def _use_text(option: str, text: str) -> None:
    # By name: no room imports the command line.
    options, camera_options = (import_module(f"edgemap.cli.{name}") for name in ("options", "camera_options"))
    read_board = import_module("edgemap.cli.calibrate_options").read_board
    question = import_module("edgemap.cli.map_show").Question

    match option:
        case "--mount":
            mount = camera_options.read_mount(text)
            assert mount is not None
            assert np.all(np.isfinite(mount.rotation_base_optical()))
        case "--intrinsics":
            lens = camera_options.read_intrinsics(text, 640, 480)
            assert lens is not None
        case "--start":
            assert np.all(np.isfinite(options.numbers(text, "--start", "X,Y,YAW_DEG")))
        case "--near":
            question.read(None, text, None, None).answer([])
        case "--inside":
            question.read(None, None, text, None).answer([])
        case "--classes":
            question.read(text, None, None, None).answer([])
        case "--board":
            read_board(text)
        case "--mqtt":
            import_module("edgemap.cli.publishers").host_and_port(text, "--mqtt", 1883)
        case "url":
            is_url(text)
            StreamDriver(text)
        case "bundle":
            store.bundle_folder(text)
        case "data":
            open_drive(text)
        case "wheel":
            read_wheels(text)
        case _:
            open_camera(text).close()
