"""Second fuzzer: requests to the live page, what its viewers say, and the answers of a server that `pull URL` asks."""

from __future__ import annotations

import asyncio
import json
import shutil
import socket
import threading
from collections.abc import Callable
from copy import deepcopy
from pathlib import Path
from random import Random
from typing import Any

import msgspec

from edgemap.geometry.errors import EdgemapError
from edgemap.runtime.inputs.open import DEMO, open_camera
from edgemap.runtime.network import store
from edgemap.runtime.network.download import download
from edgemap.runtime.step.mapper import Mapper
from edgemap.view.app import make_app
from edgemap.view.edit_api import MergeRequest, ObjectRequest, ZoneRequest
from edgemap.view.page import LivePage
from edgemap.view.pause import Pause
from edgemap.view.viewer import Ask
from reliability import drawing as d
from reliability.drawing import ValueSource
from reliability.workers import ReaderCase

TOKEN, COOKIE = "t0ken-t0ken-t0ken", "edgemap-1"
PATHS = (
    "/", "/index.html", "/main.js", "/api/run", "/api/health", "/api/faults", "/api/pose", "/api/frame", "/api/picture", "/api/map",
    "/api/objects", "/api/objects/chair-1", "/api/objects/chair-1/picture", "/api/pause", "/api/save", "/api/openapi.yaml", "/api/stream",
    "/api/objects/chair-1/merge", "/api/objects/chair-1/restore", "/api/zones", "/api/zones/zone-1", "/api/objects/{seen}",
    "/api/objects/{seen}/merge", "/api/objects/{seen}/picture",
)  # fmt: skip


class _PageRefusal(EdgemapError):
    """An answer of the page that is no success."""


def cases(scratch: Path) -> list[ReaderCase]:
    """What comes over a network. scratch: for the page's folder."""
    page, mapper = _page(scratch / "page")
    return [
        ReaderCase("page, requests", _request, lambda _, drawn: _use_request(page, mapper, drawn)),
        ReaderCase("page, viewers", _talk, lambda _, drawn: _use_talk(page, drawn)),
        ReaderCase("pull, a server's answers", _answers, _Server().use),
    ]


def _page(folder: Path) -> tuple[LivePage, Mapper]:
    """A page in the middle of the demo, its map saved into a folder."""
    from edgemap.geometry.camera.floor import FloorCamera
    from edgemap.runtime.motion.odometry.recorded import RecordedOdometry
    from edgemap.runtime.network.bundle import load_bundle
    from edgemap.runtime.step.pipeline import Pipeline
    from edgemap.runtime.step.slam import SemanticSlam

    folder.mkdir()
    page = LivePage({"camera": "demo", "live": False, "rate_hz": 10.0, "marks": {}}, folder, Pause())
    with open_camera(f"drive:{DEMO}") as camera:
        assert camera.intrinsics is not None
        assert camera.mount is not None
        assert camera.truth is not None
        floor = FloorCamera(camera.intrinsics, camera.mount)
        bundle = load_bundle(store.bundle_folder("edgemap-nano"), threads=1)
        slam = SemanticSlam(Pipeline(bundle, floor, RecordedOdometry(camera.truth, "truth")), Mapper())
        for _ in range(12):
            frame = camera.read()
            assert frame is not None
            page.write(slam.step(frame), slam.mapper.objects())
    return page, slam.mapper


# Requests, as a server hands them to the application.


def _headers(draw: ValueSource) -> list[tuple[bytes, bytes]]:
    host = (
        "127.0.0.1:8090"
        if not draw.hurt()
        else draw.pick(
            ("localhost", "[::1]:1", "evil.example", "", "127.0.0.1@x", "[::1", "a" * 500, "127.0.0.1:8090;x", "é")
        )
    )
    found = [("host", host)]
    if draw.chance(0.5):
        found.append(
            (
                "authorization",
                f"Bearer {TOKEN}" if not draw.hurt() else draw.pick(("Bearer", "Basic x", "Bearer é", "\x00")),
            )
        )
    if draw.chance(0.6):
        found.append(
            (
                "cookie",
                f"{COOKIE}={TOKEN}"
                if not draw.hurt()
                else draw.pick((f'{COOKIE}="' + "\\" * 60_000 + '"', "=;=;=", f"{COOKIE}", "é=é; " * 1000, '"')),
            )
        )
    if draw.chance(0.4):
        found.append(
            (
                "origin",
                f"http://{host}"
                if not draw.hurt()
                else draw.pick(("null", "http://[", "https://evil.example", "", "\xff", "x:y@z")),
            )
        )
    if draw.chance(0.7):
        found.append(
            (
                "content-type",
                "application/json"
                if not draw.hurt()
                else draw.pick(("text/plain", "", "application/json;charset=x", "é")),
            )
        )
    if draw.hurt():
        found.append(
            draw.pick(
                (
                    ("host", "evil.example"),
                    ("content-length", "-1"),
                    ("content-length", "9" * 30),
                    ("x" * 300, "y" * 9000),
                    ("if-none-match", "*"),
                    ("range", "bytes=9-1"),
                )
            )
        )
    return [(name.encode("latin-1"), value.encode("latin-1", "replace")) for name, value in found]


ODD_PATHS = (
    "/../page.py", "//", "/api/objects/" + "%00" * 50, "/api/objects/\x1b", "/\udcff", "/api/objects/é", "/" * 500, "", "*",
)  # fmt: skip


def _request(random: Random) -> dict[str, Any]:
    draw = ValueSource(random, damage=random.choice((0.0, 0.03, 0.1, 0.3)))
    path = draw.pick(PATHS) if not draw.hurt() else draw.pick(ODD_PATHS)
    query = draw.pick((b"", f"token={TOKEN}".encode()))
    if draw.hurt():
        query = draw.pick((b"token=", b"token=%ff", b"&" * 9000, b"token=a&token=b", b"%", b"=" * 999))
    kind = draw.pick((ObjectRequest, MergeRequest, ZoneRequest, ZoneRequest)) if not draw.hurt() else Ask
    body = d.json_bytes(draw, kind) if draw.chance(0.6) else json.dumps({"paused": draw.chance(0.5)}).encode()
    body = body if path != "/api/save" else b"{}"
    if draw.hurt():
        body = draw.pick((b"[" * 9000, b"x" * 20_000, b"\xff", b"", b"{}", b'{"paused":1}'))
    pieces = [body] if draw.chance(0.7) else [body[:3], body[3:]]
    messages: list[dict[str, Any]] = [
        {"type": "http.request", "body": piece, "more_body": number + 1 < len(pieces)}
        for number, piece in enumerate(pieces)
    ]
    if draw.hurt():
        messages = [*messages[:-1], {"type": "http.disconnect"}]
    method = "GET" if draw.chance(0.4) else draw.pick(("POST", "PATCH", "DELETE", "PUT"))
    method = method if not draw.hurt() else draw.pick(("HEAD", "OPTIONS", "get", "", "X" * 99))
    headers, token = _headers(draw), draw.chance(0.7)
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
    draw = ValueSource(random, damage=random.choice((0.0, 0.05, 0.3)))
    said = []
    for _ in range(draw.count(9)):
        data = d.json_bytes(draw, Ask)
        text = data.decode("utf-8", "replace")
        message = {
            "type": "websocket.receive",
            "text": text
            if not draw.hurt()
            else draw.pick(
                (
                    "[" * 4000,
                    "",
                    "\x00",
                    "null",
                    '{"do":"save"}' * 3,
                    '{"do":"shown","x":' + "[" * 2000 + "]" * 2000 + "}",
                )
            ),
        }
        if draw.hurt():
            message = draw.pick(
                (
                    {"type": "websocket.receive", "bytes": data},
                    {"type": "websocket.receive", "text": None, "bytes": b"\xff"},
                    {"type": "websocket.disconnect", "code": 1006},
                )
            )
        said.append(message)
    return {"headers": _headers(draw), "said": said, "token": draw.chance(0.3)}


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


def _answers(random: Random) -> list[bytes]:
    """Raw answers to one request after the other: bundle.json, then files; redirects on the way."""
    draw = ValueSource(random, damage=random.choice((0.0, 0.03, 0.1, 0.3)))
    files = {"backbone.onnx": b"not a network", "a/b.bin": b"x" * 3000}
    import hashlib

    from edgemap.runtime.network import manifest as m

    detector = m.DetectorSpec(
        file="backbone.onnx", input=m.InputSpec(name="i", width=32, height=32, resize="stretch", colour="rgb", scale=1.0), decode="yolox",
        heads=(m.HeadSpec(name="h", shape=(1, 1, 6), strides=(32,)),), features=(), classes=(m.ClassEntry(name="chair"),),
    )  # fmt: skip
    sums = {name: hashlib.sha256(data).hexdigest() for name, data in files.items()}
    if draw.hurt():
        sums[draw.pick(("../x", "/tmp/x", "bundle.json", "a", "a/b.bin/c", "é", "x" * 300, ".."))] = draw.pick(
            ("0" * 64, "/etc/x", sums["a/b.bin"])
        )
    text = msgspec.json.encode(
        m.Manifest(
            format=m.FORMAT,
            name="tiny" if not draw.hurt() else draw.text(),
            version="1",
            detector=detector,
            sha256=sums,
        )
    )
    bodies = [text if not draw.hurt() else d.json_bytes(draw, m.Manifest), *files.values(), b"more"]
    return [_answer(draw, body) for body in bodies]


def _answer(draw: ValueSource, body: bytes) -> bytes:
    status = (
        "200 OK"
        if not draw.hurt()
        else draw.pick(
            (
                "206 Partial",
                "301 x",
                "302 x",
                "307 x",
                "404 gone\x1b[2J",
                "416 x",
                "500 x",
                "204 x",
                "100 Continue",
                "999 x",
                "x",
            )
        )
    )
    headers = {"Content-Length": str(len(body))}
    if draw.hurt():
        headers["Content-Length"] = draw.pick(("-1", "0", str(len(body) + 9), "9" * 18, "9" * 400, "x", ""))
    if status[0] == "3" or draw.hurt():
        headers["Location"] = draw.pick(
            (
                "file:///etc/passwd",
                "ftp://x/",
                "http://[",
                "https://127.0.0.1:1/",
                "//x",
                "",
                "\x1b",
                "javascript:x",
                "data:,x",
                "/again",
            )
        )
    if draw.hurt():
        name = draw.pick(
            (
                "ETag",
                "Last-Modified",
                "Content-Range",
                "Content-Encoding",
                "Transfer-Encoding",
                "X" * 300,
                "Set-Cookie",
                "Content-Type",
            )
        )
        headers[name] = draw.pick(
            (
                "chunked",
                "gzip",
                "bytes 0-3/9",
                "bytes */9",
                '"' + "a" * 2000 + '"',
                "W/x",
                "\x1b[2J",
                "bytes 0-0/" + "9" * 30,
            )
        )
    if headers.get("Transfer-Encoding") == "chunked" and draw.chance(0.6):
        del headers["Content-Length"]
        body = draw.pick(
            (
                b"%x\r\n" % len(body) + body + b"\r\n0\r\n\r\n",
                b"ffffffffffff\r\nx",
                b"-1\r\n",
                b"x\r\n" + body,
                b"5\r\nab",
            )
        )
    lines = [
        f"HTTP/1.1 {status}" if not draw.hurt() else draw.pick(("HTTP/9.9 200", "", "GET /", "\0", "HTTP/1.1")),
        *(f"{name}: {value}" for name, value in headers.items()),
    ]
    if draw.hurt():
        lines += draw.pick((["x"], ["a: b"] * 200, ["y: " + "z" * 70_000], [" folded"], [": x"]))
    return "\r\n".join(lines).encode("latin-1", "replace") + b"\r\n\r\n" + body


class _Server:
    """A thread that gives the answers one connection after the other."""

    def __init__(self) -> None:
        self._socket: socket.socket | None = None
        self._answers: list[bytes] = []

    def use(self, folder: Path, answers: list[bytes]) -> None:
        """Fetch one file, then a whole bundle."""
        import os

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
