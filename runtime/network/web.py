"""Opens http and https only, also in redirects, and ends transfers that take too long."""

import http.client
import socket
import ssl
import threading
import time
import urllib.error
import urllib.request
from contextlib import suppress
from functools import cache
from typing import Any
from urllib.parse import urlsplit

from edgemap.runtime.frames.reading import one_line

LOOK_EVERY_S = 0.1


def is_url(text: str) -> bool:
    """Whether a text is an http or https URL."""
    try:
        return urlsplit(text).scheme in ("http", "https")
    except ValueError:  # `http://[`
        return False


class TimedHandler(urllib.request.HTTPSHandler, urllib.request.HTTPHandler):
    """Opens http and https and ends a transfer at a time limit, wherever it waits: also in headers that arrive byte by
    byte. It does so while it is entered as a context manager. until_s: the limit, by the monotonic clock.
    """

    def __init__(self, longest_s: float) -> None:
        super().__init__(context=trusted_certificates())
        self.until_s = time.monotonic() + longest_s
        self.over = False
        self._sockets: list[socket.socket] = []
        self._done = threading.Event()

    def http_open(self, req: Any) -> Any:
        """As the base class."""
        return self._open(http.client.HTTPConnection, req)

    def https_open(self, req: Any) -> Any:
        """As the base class."""
        return self._open(http.client.HTTPSConnection, req, context=trusted_certificates())

    def _open(self, kind: type[http.client.HTTPConnection], req: Any, **options: Any) -> Any:
        sockets = self._sockets

        class Watched(kind):
            def connect(self) -> None:
                super().connect()
                sockets.append(self.sock)

        return self.do_open(Watched, req, **options)  # type: ignore[arg-type]

    def __enter__(self) -> "TimedHandler":
        threading.Thread(target=self._watch, daemon=True).start()
        return self

    def __exit__(self, *exception: object) -> None:
        self._done.set()

    def _watch(self) -> None:
        while not self._done.wait(LOOK_EVERY_S):
            if time.monotonic() > self.until_s:
                self.over = True
                for one in self._sockets:
                    with suppress(OSError):
                        one.shutdown(socket.SHUT_RDWR)


@cache
def trusted_certificates() -> ssl.SSLContext:
    """The system's certificates, read once, as reading takes 20 ms."""
    return ssl.create_default_context()


class WebOnly(urllib.request.HTTPRedirectHandler):
    """Follows redirects to http and https only, never from https to http; bodies of redirects are not read."""

    def http_error_302(self, req: Any, fp: Any, code: int, msg: str, headers: Any) -> Any:
        """As the base class, without reading the redirect's body into memory."""
        fp.read = bytes
        return super().http_error_302(req, fp, code, msg, headers)

    http_error_301 = http_error_303 = http_error_307 = http_error_308 = http_error_302

    def redirect_request(self, req: Any, fp: Any, code: int, msg: str, headers: Any, newurl: str) -> Any:
        """As the base class, after the check. Raises ValueError."""
        if not is_url(newurl) or (urlsplit(req.full_url).scheme == "https" and urlsplit(newurl).scheme != "https"):
            raise ValueError(
                f"redirected to {one_line(newurl, 80)}: only http and https are followed, never https to http"
            )
        return super().redirect_request(req, fp, code, msg, headers, newurl)
