"""The HTTP API of a run: what it maps and how it goes, to be read by any program. docs/http-api.md documents it."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Annotated, TypeVar

import msgspec
from msgspec import Meta
from starlette.requests import ClientDisconnect, Request
from starlette.responses import Response
from starlette.routing import Route

from edgemap.geometry.errors import EdgemapError
from edgemap.geometry.objects.edits import MAXIMUM_CORNERS, Edit, EditError
from edgemap.runtime.map_file import GivenName
from edgemap.runtime.reading import Coordinate
from edgemap.view import answers
from edgemap.view.page import LivePage, Moment
from edgemap.view.updates import Pictures, Vitals

BODY_BYTES = 16_384
BODY_LIMIT_S = 5.0  # for a body to come: one that never does holds a connection
EDIT_LIMIT_S = 5.0
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


class ObjectWish(msgspec.Struct, forbid_unknown_fields=True):
    """Body of PATCH /api/objects/{id}: what is to change."""

    name: GivenName | None = None
    confirmed: bool | None = None


class MergeWish(msgspec.Struct, forbid_unknown_fields=True):
    """Body of POST /api/objects/{id}/merge."""

    into: GivenName


class ZoneWish(msgspec.Struct, forbid_unknown_fields=True):
    """Body of POST /api/zones and PUT /api/zones/{id}."""

    name: GivenName
    corners_m: Annotated[list[tuple[Coordinate, Coordinate]], Meta(min_length=3, max_length=MAXIMUM_CORNERS)]


class Nothing(msgspec.Struct, forbid_unknown_fields=True):
    """A body that says nothing: `{}`."""


class Api:
    """Answers for one page. Every failure is JSON with one line: `{"error": "…"}`."""

    def __init__(self, page: LivePage, pictures: Pictures, vitals: Vitals) -> None:
        self._page, self._pictures, self._vitals = page, pictures, vitals

    def routes(self) -> list[Route]:
        """All addresses under /api."""
        routes: list[tuple[str, str, Answer]] = [
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
            ("PATCH", "/api/objects/{id}", self.change_object),
            ("DELETE", "/api/objects/{id}", self.delete_object),
            ("POST", "/api/objects/{id}/merge", self.merge_object),
            ("POST", "/api/objects/{id}/restore", self.restore_object),
            ("GET", "/api/zones", self.zones),
            ("POST", "/api/zones", self.put_zone),
            ("PUT", "/api/zones/{id}", self.put_zone),
            ("DELETE", "/api/zones/{id}", self.delete_zone),
            ("POST", "/api/pause", self.pause),
            ("POST", "/api/save", self.save),
            ("GET", "/api/openapi.yaml", self.openapi),
        ]
        return [Route(path, _guarded(answer), methods=[method]) for method, path, answer in routes]

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
        await _body(request, Nothing)
        return _json({"path": str(await asyncio.to_thread(self._page.save))})

    async def openapi(self, request: Request) -> Response:  # noqa: ARG002
        """This API as OpenAPI text."""
        return Response(OPENAPI.read_bytes(), media_type="application/yaml")

    async def change_object(self, request: Request) -> Response:
        """Name an object, confirm it, or take either back."""
        wish, identity = await _body(request, ObjectWish), self._object(request)["id"]
        if wish.name is not None:
            await self._edit(Edit("rename", identity, name=wish.name))
        if wish.confirmed is not None:
            await self._edit(Edit("confirm", identity, on=wish.confirmed))
        return _json(self._object(request))

    async def delete_object(self, request: Request) -> Response:
        """Take an object off the map, and keep it off."""
        return _json({"id": await self._edit(Edit("delete", self._object(request)["id"]))})

    async def merge_object(self, request: Request) -> Response:
        """Say that two objects are one."""
        wish = await _body(request, MergeWish)
        self._find(wish.into)
        await self._edit(Edit("merge", self._object(request)["id"], into=wish.into))
        return _json(self._find(wish.into))

    async def restore_object(self, request: Request) -> Response:
        """Take back that an object was deleted or merged."""
        await _body(request, Nothing)
        return _json({"id": await self._edit(Edit("restore", request.path_params["id"]))})

    async def zones(self, request: Request) -> Response:  # noqa: ARG002
        """The zones, with the objects in each."""
        return _json(answers.zones_answer(self._page))

    async def put_zone(self, request: Request) -> Response:
        """Draw a zone, or change one."""
        wish, identity = await _body(request, ZoneWish), request.path_params.get("id", "")
        if identity and identity not in {zone.id for zone in self._page.annotations.zones}:
            raise Refused(404, f"no zone {identity[:60]!r}")
        made = await self._edit(Edit("zone", identity, name=wish.name, corners_m=tuple(wish.corners_m)))
        zone = next(zone for zone in answers.zones_answer(self._page) if zone["id"] == made)
        return _json(zone, 200 if identity else 201)

    async def delete_zone(self, request: Request) -> Response:
        """Take a zone away."""
        identity = request.path_params["id"]
        if identity not in {zone.id for zone in self._page.annotations.zones}:
            raise Refused(404, f"no zone {identity[:60]!r}")
        return _json({"id": await self._edit(Edit("drop_zone", identity))})

    async def _edit(self, edit: Edit) -> str:
        """Have the run take an edit between two steps; the id of its object or zone."""
        self._moment()
        future = asyncio.wrap_future(self._page.edits.submit(edit))
        try:
            return await asyncio.wait_for(future, EDIT_LIMIT_S)
        except EditError as error:
            raise Refused(409, str(error)) from None
        except TimeoutError:
            raise Refused(503, f"the run took no edit for {EDIT_LIMIT_S:.0f} s; this one is withdrawn") from None

    def _moment(self) -> Moment:
        if self._page.newest is None:
            raise Refused(503, "no picture yet")
        return self._page.newest

    def _object(self, request: Request) -> dict:
        return self._find(request.path_params["id"])

    def _find(self, identity: str) -> dict:
        moment = self._moment()
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
        async with asyncio.timeout(BODY_LIMIT_S):
            async for chunk in request.stream():
                data += chunk
                if len(data) > BODY_BYTES:
                    raise Refused(413, f"at most {BODY_BYTES} bytes")
    except TimeoutError:
        raise Refused(408, f"the body did not come within {BODY_LIMIT_S:g} s") from None
    except ClientDisconnect:
        raise Refused(400, "the body was cut off") from None
    try:
        return msgspec.json.decode(data, type=kind)
    except (msgspec.MsgspecError, UnicodeError) as error:
        raise Refused(400, str(error)) from None
    except RecursionError:
        raise Refused(400, "nested too deeply") from None
