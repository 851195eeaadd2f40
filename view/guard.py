"""Access control: every request's Host, Origin and token are checked before it is handled."""

import ipaddress
import re
import secrets
import socket
from urllib.parse import parse_qs

from starlette.datastructures import Headers, MutableHeaders
from starlette.responses import JSONResponse, PlainTextResponse, RedirectResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

# A name, an address, or an IPv6 one in brackets; a port. Nothing else, for it comes back in the page's own headers.
HOST = re.compile(r"(?:(?P<name>[A-Za-z0-9.-]{1,253})|\[(?P<address>[0-9A-Fa-f:.]{2,45})\])(?::\d{1,5})?")
NO_TOKEN = "This page needs its token: open the address that edgemap printed in the robot's terminal."


class Guard:
    """ASGI middleware. token: what a request must bring, empty for none. cookie: name under which browsers keep it.

    Host must be an address, localhost or this machine's own name: a foreign name that was made to point here (DNS
    rebinding) is refused. Origin, where a browser sends one, must be the page's own, so no other site's script talks
    to the socket; nor does another site show the picture (Sec-Fetch-Site). The token comes in a cookie, as `?token=`,
    or as `Authorization: Bearer`; `/?token=` sets the cookie and drops the token from the address bar.
    """

    def __init__(self, app: ASGIApp, token: str, cookie: str) -> None:
        self._app, self._token, self._cookie = app, token, cookie
        self._names = own_names()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Refuse, or pass on, and add `_headers` to each answer, also to errors."""
        if scope["type"] not in ("http", "websocket"):
            return

        async def sealed(message: Message) -> None:
            if message["type"] == "http.response.start":
                MutableHeaders(scope=message).update(_headers(Headers(scope=scope)["host"]))
            await send(message)

        refusal = self._refusal(scope)
        if refusal is None:
            await self._app(scope, receive, sealed)
        elif scope["type"] == "websocket":
            await receive()
            await send({"type": "websocket.close", "code": 1008})
        else:
            await refusal(scope, receive, send)

    def _refusal(self, scope: Scope) -> Response | None:
        headers = {name.decode("latin-1").lower(): value.decode("latin-1") for name, value in scope["headers"]}
        host = headers.get("host", "")
        if not self._is_own(host):
            return _refused(scope, f"{host!r} is not a name of this robot", 400)
        if not scope.get("query_string", b"").isascii():  # as RFC 3986 has it; starlette would fail at it
            return _refused(scope, "the query is not ASCII", 400)
        if _from_another_site(scope, headers):
            return _refused(scope, "requests from other sites are refused", 403)
        if not self._token:
            return None
        asked = parse_qs(scope.get("query_string", b"").decode("latin-1")).get("token", [""])[0]
        if scope["type"] == "http" and scope["path"] == "/" and self._matches(asked):
            response = RedirectResponse("/", 303)
            response.set_cookie(self._cookie, asked, httponly=True, samesite="lax", path="/")
            return response
        bearer = headers.get("authorization", "").removeprefix("Bearer ")
        if any(self._matches(given) for given in (asked, bearer, cookie_value(headers, self._cookie))):
            return None
        return _refused(scope, NO_TOKEN, 401)

    def _matches(self, given: str) -> bool:
        return secrets.compare_digest(given.encode(), self._token.encode())

    def _is_own(self, host: str) -> bool:
        if not (parts := HOST.fullmatch(host)):
            return False
        name = (parts["name"] or parts["address"]).lower()
        try:
            return name in self._names or bool(ipaddress.ip_address(name))
        except ValueError:
            return False


def _refused(scope: Scope, text: str, status: int) -> Response:
    """One line: JSON for paths below /api/, as all errors of the API, otherwise text."""
    if scope["path"].startswith("/api/"):
        return JSONResponse({"error": text}, status)
    return PlainTextResponse(f"{text}\n", status)


def _headers(host: str) -> dict[str, str]:
    """Security headers: no content of other origins, no frames of other pages, no cache. host: checked by the guard."""
    policy = f"default-src 'self'; connect-src 'self' ws://{host} wss://{host}; img-src 'self' blob: data:"
    return {
        "Content-Security-Policy": f"{policy}; frame-ancestors 'none'; base-uri 'none'; form-action 'none'",
        "Cross-Origin-Resource-Policy": "same-origin",
        "X-Content-Type-Options": "nosniff",
        "Referrer-Policy": "no-referrer",
        "Cache-Control": "no-store",
    }


def _from_another_site(scope: Scope, headers: dict[str, str]) -> bool:
    """Whether another site's page asks: by a script, a picture or a frame. Its links to the page itself may be
    followed. Source: W3C, Fetch Metadata Request Headers; programs that are no browser send none."""
    origin, host = headers.get("origin", "").lower(), headers["host"].lower()
    if "origin" in headers and origin not in (f"http://{host}", f"https://{host}"):
        return True
    if headers.get("sec-fetch-site", "none") in ("none", "same-origin"):
        return False
    followed = headers.get("sec-fetch-mode") == "navigate" and headers.get("sec-fetch-dest") == "document"
    return not (followed and scope["path"] == "/" and scope.get("method") == "GET")


def own_names() -> frozenset[str]:
    """Host names that a Host header may contain besides plain addresses."""
    machine = socket.gethostname().lower()
    return frozenset({"localhost", machine, f"{machine.split('.')[0]}.local", f"{machine.split('.')[0]}.lan"})


def cookie_value(headers: dict[str, str], name: str) -> str:
    """The cookie's value, which is never quoted: Python's own reader of quoted ones takes quadratic time."""
    pairs = (pair.strip().partition("=") for pair in headers.get("cookie", "").split(";"))
    return next((value for key, _, value in pairs if key == name), "")
