"""The HTTP routes of a run: the files of the page, the API that the page uses, and the WebSocket stream."""

from pathlib import Path

from starlette.applications import Starlette
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import PlainTextResponse, Response
from starlette.routing import Route, WebSocketRoute
from starlette.types import ASGIApp
from starlette.websockets import WebSocket

from edgemap.geometry.errors import EdgemapError
from edgemap.view import answers
from edgemap.view.api import api_routes
from edgemap.view.guard import Guard
from edgemap.view.page import LivePage
from edgemap.view.questions import Refused
from edgemap.view.updates import ProcessUsage
from edgemap.view.viewer import Bell, Viewer

STATIC = Path(__file__).parent / "static"
KINDS = {".html": "text/html", ".css": "text/css", ".js": "text/javascript", ".svg": "image/svg+xml"}
MAXIMUM_VIEWERS = 8
TRY_AGAIN_LATER = 1013


def make_app(page: LivePage, token: str = "", cookie: str = "edgemap") -> ASGIApp:
    """The page as an ASGI application. token: required in each request; empty for none."""
    files = {f"/{path.name}": (path.read_bytes(), KINDS[path.suffix]) for path in STATIC.iterdir()}
    files["/"] = files["/index.html"]
    usage, bell = ProcessUsage(), Bell(page)
    viewers: set[Viewer] = set()

    async def file(request: Request) -> Response:
        content, kind = files[request.url.path]
        return Response(content, media_type=kind)

    async def socket(websocket: WebSocket) -> None:
        if len(viewers) >= MAXIMUM_VIEWERS:
            await websocket.accept()
            await websocket.close(TRY_AGAIN_LATER, f"{MAXIMUM_VIEWERS} viewers are looking already")
            return
        viewer = Viewer(websocket, page, bell, usage)
        viewers.add(viewer)
        try:
            await viewer.serve()
        finally:
            viewers.discard(viewer)

    routes = [Route(path, file) for path in files]
    routes += [*api_routes(page, usage), WebSocketRoute("/api/stream", socket)]
    app = Starlette(routes=routes, exception_handlers={HTTPException: _refused, EdgemapError: _refused})
    return Guard(app, token, cookie)


async def _refused(request: Request, error: Exception) -> Response:
    """Response to an error, such as an unknown path or method: JSON for paths below /api/, otherwise text."""
    status, headers = (error.status_code, error.headers) if isinstance(error, HTTPException) else (500, None)
    if isinstance(error, Refused):
        text = error.detail
    elif status in (404, 405):
        text = f"{request.method} {request.url.path[:60]!a} is not in this API"
    else:
        text = str(error)
    if request.url.path.startswith("/api/"):
        return Response(answers.plain({"error": text}), status, headers, media_type="application/json")
    return PlainTextResponse(f"{text}\n", status, headers)
