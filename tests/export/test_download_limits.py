"""Downloads from a server that is no friend: redirects, endless and slow bodies, marks made of control characters."""

import threading
import time
from contextlib import suppress
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from types import SimpleNamespace

import pytest
from support.refusal import refused

from edgemap.runtime.network import web as module
from edgemap.runtime.network.download import DownloadError, download
from edgemap.runtime.network.web import is_url


class Hostile(BaseHTTPRequestHandler):
    def do_GET(self):
        where = {"/file": "file:///etc/passwd", "/ftp": "ftp://127.0.0.1/x", "/loop": "/loop", "/good": "/body"}
        if self.path in ("/301", "/302", "/307"):
            self.send_response(int(self.path[1:]))
            self.send_header("Location", "/body")
            self.send_header("Content-Length", "9" * (18 if self.path == "/301" else 400))
            self.end_headers()
            with suppress(OSError):
                self.wfile.write(bytes(1 << 24))
            return
        if self.path in where:
            self.send_response(302)
            self.send_header("Location", where[self.path])
            self.end_headers()
            return
        if self.path == "/headers":
            with suppress(OSError):
                self.wfile.write(b"HTTP/1.1 200 OK\r\n")
                while True:
                    self.wfile.write(b"X: x\r\n"[:1])
                    time.sleep(0.05)
            return
        if self.path == "/chunk":
            with suppress(OSError):
                self.wfile.write(b"HTTP/1.1 200 OK\r\nTransfer-Encoding: chunked\r\n\r\n")
                while True:
                    self.wfile.write(b"0")
                    time.sleep(0.05)
            return
        self.send_response(200)
        if self.path == "/body":
            self.send_header("Content-Length", "4")
        if self.path == "/length":
            self.send_header("Content-Length", "9" * 5000)
        self.end_headers()
        try:
            if self.path == "/drip":
                while True:
                    self.wfile.write(b"x")
                    time.sleep(0.05)
            else:
                self.wfile.write(b"body" if self.path == "/body" else bytes(100_000))
        except OSError:
            pass

    def log_message(self, *_):
        pass


@pytest.fixture(scope="module")
def address():
    server = ThreadingHTTPServer(("127.0.0.1", 0), Hostile)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    yield f"http://127.0.0.1:{server.server_port}"
    server.shutdown()
    server.server_close()


def refusal(url, path, **limits) -> str:
    text = refused(DownloadError, download, url, path, progress=False, **limits)
    assert not path.exists()
    return text


@pytest.mark.parametrize(("path", "words"), [("/file", "is not allowed"), ("/ftp", "only http and https are followed")])
def test_a_redirect_leaves_the_web_for_nothing_else(address, tmp_path, path, words):
    assert words in refusal(address + path, tmp_path / "f")


def test_a_redirect_on_the_web_is_followed(address, tmp_path):
    assert download(address + "/good", tmp_path / "f", progress=False).read_bytes() == b"body"


@pytest.mark.parametrize("path", ["/301", "/302", "/307"])
def test_the_body_of_a_redirect_is_not_read(address, tmp_path, path):
    """Whatever its length says: memory for it was an error of its own, and no limit held for what came."""
    assert download(address + path, tmp_path / "f", progress=False).read_bytes() == b"body"


def test_https_never_becomes_http():
    handler = module.WebOnly()
    request = module.urllib.request.Request("https://host/a")
    with pytest.raises(ValueError, match="never https to http"):
        handler.redirect_request(request, None, 302, "", {}, "http://host/a")


def test_loops_and_impossible_lengths_end(address, tmp_path):
    refusal(address + "/loop", tmp_path / "f")
    refusal(address + "/length", tmp_path / "f", maximum_bytes=50_000)


def test_a_body_without_end_stops_at_the_limit(address, tmp_path):
    assert "more than 50,000 bytes, stopped" in refusal(address + "/endless", tmp_path / "f", maximum_bytes=50_000)


def test_a_drip_stops_at_the_time_limit(address, tmp_path):
    assert "too slow" in refusal(address + "/drip", tmp_path / "f", longest_s=0.2)  # it would drip for ever


@pytest.mark.parametrize("text", ["file:///etc/passwd", "ftp://x/y", "http://[", "x", "", "data:,x"])
def test_what_is_no_url(text):
    assert not is_url(text)


@pytest.mark.parametrize("path", ["/headers", "/chunk"])
def test_headers_and_lengths_that_come_drop_by_drop_stop_at_the_time_limit(address, tmp_path, path):
    """Each drop is in time for the socket; only the whole is not."""
    words = refusal(address + path, tmp_path / "f", longest_s=0.3, timeout_s=5.0)
    assert "too slow" in words or "no answer within 0.3 s" in words


def test_a_cache_that_cannot_be_written_is_one_line(address, tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(DownloadError, match=r"Not a directory|File exists"):
        download(f"{address}/body", tmp_path / "file" / "f", progress=False)


def test_the_files_of_a_bundle_have_one_limit_together(monkeypatch, tmp_path):
    from edgemap.runtime.network import store

    asked = []

    def fetched(url, target, *, maximum_bytes=0, **_):
        asked.append(maximum_bytes)
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_bytes(bytes(1000))
        return target

    manifest = SimpleNamespace(name="b", sha256={"a": "1" * 64, "b": "2" * 64})
    monkeypatch.setenv("EDGEMAP_CACHE", str(tmp_path))
    monkeypatch.setattr(store, "download", fetched)
    monkeypatch.setattr(store, "read_manifest", lambda _: manifest)
    store.install_url("http://127.0.0.1:1/b")
    assert asked[1:] == [store.BUNDLE_BYTES, store.BUNDLE_BYTES - 1000]
