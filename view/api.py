"""The HTTP API of a run: what it maps and how it goes, to be read by any program. docs/http-api.md tells the same."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import TypeVar

import msgspec
from starlette.requests import ClientDisconnect, Request
from starlette.responses import Response
from starlette.routing import Route

from edgemap.geometry.errors import EdgemapError
from edgemap.view import answers
from edgemap.view.page import LivePage, Moment
from edgemap.view.updates import Pictures, Vitals

BODY_BYTES = 16_384
OPENAPI = Path(__file__).parent / "openapi.yaml"

T = TypeVar("T")
Answer = Callable[[Request], Awaitable[Response]]


class Refused(Exception):
    """A request that cannot be answered: HTTP status and one line."""

    def __init__(self, status: int, text: str) -> None:
        super().__init__(text)
        self.status = status


class PauseWish(msgspec.Struct, forbid_unknown_fields=True):
    """Body of POST /api/pause."""

    paused: bool


class Api:
    """Answers for one page. Every failure is JSON with one line: `{"error": "…"}`."""

    def __init__(self, page: LivePage, pictures: Pictures, vitals: Vitals) -> None:
        self._page, self._pictures, self._vitals = page, pictures, vitals

    def routes(self) -> list[Route]:
        """All addresses under /api."""
        told: list[tuple[str, str, Answer]] = [
            ("GET", "/api/run", self.run),
            ("GET", "/api/health", self.health),
            ("GET", "/api/faults", self.faults),
            ("GET", "/api/pose", self.pose),
            ("GET", "/api/frame", self.frame),
            ("GET", "/api/picture", self.picture),
            ("GET", "/api/map", self.map),
            ("GET", "/api/objects", self.objects),
            ("GET", "/api/objects/{id}", self.object),
            ("GET", "/api/objects/{id}/picture", self.object_picture),
            ("POST", "/api/pause", self.pause),
            ("POST", "/api/save", self.save),
            ("GET", "/api/openapi.yaml", self.openapi),
        ]
        return [Route(path, _guarded(answer), methods=[method]) for method, path, answer in told]

    async def run(self, request: Request) -> Response:  # noqa: ARG002
        """What runs: camera, bundle, odometry, colours and marks of the labels."""
        return _json(self._page.about | {"state": self._page.state})

    async def health(self, request: Request) -> Response:  # noqa: ARG002
        """How the run goes."""
        return _json(answers.health_answer(self._page, self._vitals.now()))

    async def faults(self, request: Request) -> Response:  # noqa: ARG002
        """The last faults, oldest first."""
        return _json([answers.fault_answer(fault) for fault in self._page.faults.all()])

    async def pose(self, request: Request) -> Response:  # noqa: ARG002
        """Where the robot is."""
        return _json(answers.pose_answer(self._moment().result))

    async def frame(self, request: Request) -> Response:  # noqa: ARG002
        """Boxes of the newest picture, and the time of every stage."""
        return _json(answers.frame_answer(self._moment().result))

    async def picture(self, request: Request) -> Response:  # noqa: ARG002
        """The newest picture."""
        frame = self._moment().result.frame
        return Response(self._pictures.jpeg(frame), media_type="image/jpeg", headers={"X-Frame": str(frame.index)})

    async def map(self, request: Request) -> Response:  # noqa: ARG002
        """The map as the run folder's map.json."""
        headers = {"Content-Disposition": 'attachment; filename="map.json"'}
        return Response(self._page.map_text(), media_type="application/json", headers=headers)

    async def objects(self, request: Request) -> Response:  # noqa: ARG002
        """All objects, nearest first."""
        return _json(answers.objects_answer(self._page.newest))

    async def object(self, request: Request) -> Response:
        """One object."""
        return _json(self._object(request))

    async def object_picture(self, request: Request) -> Response:
        """The best picture of an object that this run has."""
        identity = self._object(request)["id"]
        crop = self._page.crops.of([identity]).get(identity)
        if crop is None:
            raise Refused(404, f"no picture of {identity} yet: it was not seen by this run")
        return Response(crop.jpeg, media_type="image/jpeg", headers={"X-Frame": str(crop.frame)})

    async def pause(self, request: Request) -> Response:
        """Hold or resume a run of files."""
        wish = await _body(request, PauseWish)
        if self._page.pause is None:
            raise Refused(409, "the camera is live: it cannot be paused")
        if self._page.state == "finished":
            raise Refused(409, "the run is over")
        self._page.set_paused(wish.paused)
        return _json({"state": self._page.state})

    async def save(self, request: Request) -> Response:
        """Keep a copy of the map in the run folder."""
        await _body(request, msgspec.Struct)
        return _json({"path": str(await asyncio.to_thread(self._page.save))})

    async def openapi(self, request: Request) -> Response:  # noqa: ARG002
        """This API as OpenAPI text."""
        return Response(OPENAPI.read_bytes(), media_type="application/yaml")

    def _moment(self) -> Moment:
        if self._page.newest is None:
            raise Refused(503, "no picture yet")
        return self._page.newest

    def _object(self, request: Request) -> dict:
        identity, moment = request.path_params["id"], self._moment()
        for item in moment.objects:
            if item.id == identity:
                return answers.object_answer(item, moment)
        raise Refused(404, f"no object {identity[:60]!r} on the map")


def _json(value: object, status: int = 200) -> Response:
    return Response(answers.plain(value), status, media_type="application/json")


def _guarded(answer: Answer) -> Answer:
    """The answer, or its failure as JSON."""

    async def guarded(request: Request) -> Response:
        try:
            return await answer(request)
        except Refused as refused:
            return _json({"error": str(refused)}, refused.status)
        except EdgemapError as error:
            return _json({"error": str(error)}, 500)

    return guarded


async def _body(request: Request, kind: type[T]) -> T:
    """The JSON body as a checked record. Only JSON is taken: a form of another site cannot send it."""
    if request.headers.get("content-type", "").split(";")[0].strip().lower() != "application/json":
        raise Refused(415, "the body must be application/json")
    data = b""
    try:
        async for chunk in request.stream():
            data += chunk
            if len(data) > BODY_BYTES:
                raise Refused(413, f"at most {BODY_BYTES} bytes")
    except ClientDisconnect:
        raise Refused(400, "the body was cut off") from None
    try:
        return msgspec.json.decode(data, type=kind)
    except (msgspec.MsgspecError, UnicodeError) as error:
        raise Refused(400, str(error)) from None
    except RecursionError:
        raise Refused(400, "nested too deeply") from None
