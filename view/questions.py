"""Common parts of the API's handlers: JSON bodies, errors, and the page that they query."""

import asyncio
from collections.abc import Iterable
from typing import TypeVar

import msgspec
from starlette.exceptions import HTTPException
from starlette.requests import ClientDisconnect, Request
from starlette.responses import Response

from edgemap.geometry.grid.rooms import Room
from edgemap.geometry.map_object import MapObject
from edgemap.geometry.objects.annotations import Zone
from edgemap.geometry.objects.events import Edit, EditError
from edgemap.view import answers
from edgemap.view.page import LivePage, PageSnapshot

BODY_BYTES = 16_384
BODY_LIMIT_S = 5.0  # for a body to come: one that never does holds a connection
EDIT_LIMIT_S = 5.0

T = TypeVar("T")
Item = TypeVar("Item", MapObject, Room, Zone)


class Refused(HTTPException):
    """A request that cannot be answered: HTTP status and one line."""


class Nothing(msgspec.Struct, forbid_unknown_fields=True):
    """An empty body: `{}`."""


def newest_of(page: LivePage) -> PageSnapshot:
    """The newest step. Raises Refused before the first."""
    if page.newest is None:
        raise Refused(503, "no picture yet")
    return page.newest


def named(page: LivePage, request: Request) -> MapObject:
    """The object that the address names. Raises Refused."""
    return one_of(newest_of(page).objects, request.path_params["id"], "object")


def one_of(items: Iterable[Item], identity: str, kind: str) -> Item:
    """An object, a room or a zone by its id. Raises Refused."""
    for item in items:
        if item.id == identity:
            return item
    raise Refused(404, f"no {kind} {identity[:60]!r} on the map")


def object_json(page: LivePage, identity: str, status: int = 200) -> Response:
    """An object as JSON. Raises Refused."""
    snapshot = newest_of(page)
    return as_json(answers.object_answer(one_of(snapshot.objects, identity, "object"), snapshot), status)


async def take(page: LivePage, edit: Edit) -> str:
    """Have the run take an edit between two steps; the id of its object or zone. Raises Refused."""
    newest_of(page)
    future = asyncio.wrap_future(page.edits.submit(edit))
    try:
        return await asyncio.wait_for(future, EDIT_LIMIT_S)
    except EditError as error:
        raise Refused(409, str(error)) from None
    except TimeoutError:
        raise Refused(503, f"the run took no edit for {EDIT_LIMIT_S:.0f} s; this one is withdrawn") from None


def as_json(value: object, status: int = 200) -> Response:
    """A JSON answer."""
    return Response(answers.plain(value), status, media_type="application/json")


async def body_of(request: Request, kind: type[T]) -> T:
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
