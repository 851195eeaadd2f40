"""The page's addresses: its files, the map to download, and the socket."""

from __future__ import annotations

from pathlib import Path

from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import Route, WebSocketRoute
from starlette.types import ASGIApp
from starlette.websockets import WebSocket

from edgemap.view.guard import Guard
from edgemap.view.page import LivePage
from edgemap.view.updates import Pictures, Vitals
from edgemap.view.viewer import Bell, Viewer

STATIC = Path(__file__).parent / "static"
KINDS = {".html": "text/html", ".css": "text/css", ".js": "text/javascript", ".svg": "image/svg+xml"}
MOST_VIEWERS = 8
TRY_AGAIN_LATER = 1013


def make_app(page: LivePage, token: str = "", cookie: str = "edgemap") -> ASGIApp:
    """The page as an ASGI application. token: demanded of every request; empty for none."""
    files = {f"/{path.name}": (path.read_bytes(), KINDS[path.suffix]) for path in STATIC.iterdir()}
    files["/"] = files["/index.html"]
    pictures, vitals, bell = Pictures(), Vitals(), Bell(page)
    viewers: set[Viewer] = set()

    async def file(request: Request) -> Response:
        content, kind = files[request.url.path]
        return Response(content, media_type=kind, headers=_headers(request))

    async def download(request: Request) -> Response:
        headers = _headers(request) | {"Content-Disposition": 'attachment; filename="map.json"'}
        return Response(page.map_text(), media_type="application/json", headers=headers)

    async def socket(websocket: WebSocket) -> None:
        if len(viewers) >= MOST_VIEWERS:
            await websocket.accept()
            await websocket.close(TRY_AGAIN_LATER, f"{MOST_VIEWERS} viewers are looking already")
            return
        viewer = Viewer(websocket, page, bell, pictures, vitals)
        viewers.add(viewer)
        try:
            await viewer.serve()
        finally:
            viewers.discard(viewer)

    routes = [Route(path, file) for path in files]
    routes += [Route("/map.json", download), WebSocketRoute("/socket", socket)]
    return Guard(Starlette(routes=routes), token, cookie)


def _headers(request: Request) -> dict[str, str]:
    """Nothing from elsewhere, nobody's frame, nothing kept."""
    host = request.headers["host"]  # the guard has seen that it is ours
    policy = f"default-src 'self'; connect-src 'self' ws://{host} wss://{host}; img-src 'self' blob: data:"
    return {
        "Content-Security-Policy": f"{policy}; frame-ancestors 'none'; base-uri 'none'; form-action 'none'",
        "X-Content-Type-Options": "nosniff",
        "Referrer-Policy": "no-referrer",
        "Cache-Control": "no-store",
    }
