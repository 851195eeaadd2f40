"""The page's web server: bound at once, served from a separate thread, and never the end of the run. The number of idle
connections is limited: a new one closes the oldest."""

import asyncio
import ipaddress
import secrets
import socket
import threading
from os import strerror
from typing import Any

import uvicorn
from uvicorn.protocols.http.h11_impl import H11Protocol

from edgemap.geometry.errors import EdgemapError
from edgemap.runtime.frames.reading import print_message
from edgemap.view.app import make_app
from edgemap.view.page import LivePage


class ViewError(EdgemapError):
    """An address that the live page cannot be served on."""


class PageServer:
    """Serves a page until `close`. host: a name or address of this machine; beyond loopback a token is required. port:
    0 for any free one. The run continues where the server fails. Raises ViewError, one line, where the address cannot
    be bound.
    """

    def __init__(self, page: LivePage, host: str, port: int) -> None:
        self._socket, self.page = _bind(host, port), page
        address, self.port = self._socket.getsockname()[:2]
        self.token = "" if ipaddress.ip_address(address).is_loopback else secrets.token_urlsafe(16)
        shown = reachable(address)
        shown = f"[{shown}]" if ":" in shown else shown
        self.url = f"http://{shown}:{self.port}/" + (f"?token={self.token}" if self.token else "")
        config = uvicorn.Config(
            make_app(page, self.token, f"edgemap-{self.port}"),
            log_level="error", access_log=False, lifespan="off", server_header=False, ws_max_size=4096,
            ws_per_message_deflate=False, timeout_graceful_shutdown=1, limit_concurrency=64,
            http=WaitingLimited,
        )  # fmt: skip
        self._server = uvicorn.Server(config)
        self._thread = threading.Thread(target=self._serve, name="live page", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Refuses edits that still wait, closes the viewers' connections and releases the port; may be called twice."""
        self.page.edits.end()  # a request that waits for one would be cut off with a traceback
        self._server.should_exit = True
        self._thread.join(timeout=3.0)
        self._socket.close()

    def _serve(self) -> None:
        why = "the server ended"
        try:
            self._server.run(sockets=[self._socket])
        except BaseException as error:  # whatever it is, the map is worth more than the page
            why = f"{type(error).__name__}: {error}"
        if not self._server.should_exit:
            print_message(f"the live page is gone ({why}); the run goes on")


def _bind(host: str, port: int) -> socket.socket:
    if not 0 <= port <= 65535:
        raise ViewError(f"--view {host}:{port}: the port must be 0 to 65535")
    try:
        family, *_, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
    except (socket.gaierror, UnicodeError):
        raise ViewError(f"--view {host!r}: not a name or address of this machine") from None
    both = family == socket.AF_INET6 and socket.has_dualstack_ipv6()  # `::` serves IPv4 as well
    try:
        return socket.create_server(address, family=family, dualstack_ipv6=both)
    except OSError as error:
        other = "; choose another --view HOST:PORT, or port 0 for any free one"
        raise ViewError(f"the live page cannot have {host}:{port} ({strerror(error.errno or 0)}){other}") from None


def reachable(address: str) -> str:
    """The address to display for a bound one: for the wildcard address, the one reachable from the network."""
    if not ipaddress.ip_address(address).is_unspecified:
        return address
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect(("192.0.2.1", 9))  # sends nothing: asks the routing table which of our addresses goes out
            return probe.getsockname()[0]
        except OSError:
            return socket.gethostname()


WAITING_LIMIT = 32

_Base: Any = H11Protocol  # uvicorn's other one, taken where httptools is installed, bounds no headers


class WaitingLimited(_Base):
    """uvicorn's HTTP protocol. A connection is idle while none of its requests is being answered, also while its
    headers arrive slowly. A client that sends its request at once is answered, no matter how many idle connections
    there are.
    """

    def connection_made(self, transport: asyncio.Transport) -> None:
        """As in the base class; closes the oldest idle connection beyond the limit."""
        super().connection_made(transport)
        self.made_s = asyncio.get_running_loop().time()
        waiting = [one for one in self.connections if isinstance(one, WaitingLimited) and one.waits]
        for one in sorted(waiting, key=lambda one: one.made_s)[:-WAITING_LIMIT]:
            one.transport.abort()
            self.connections.discard(one)

    @property
    def waits(self) -> bool:
        """Whether no request is being answered."""
        return self.cycle is None or self.cycle.response_complete
