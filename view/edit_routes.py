"""The part of the HTTP API that edits: objects, zones, rooms, the dock and the robot's pose."""

import asyncio
import math
from typing import Annotated

import msgspec
from msgspec import Meta
from starlette.requests import Request
from starlette.responses import Response

from edgemap.geometry.grid.rooms import Door, Room
from edgemap.geometry.map_object import MapObject
from edgemap.geometry.objects.annotations import LONGEST_NAME, MAXIMUM_CORNERS
from edgemap.geometry.objects.events import LARGEST_M, SMALLEST_M, Edit, joined
from edgemap.geometry.objects.rooms import rooms_of
from edgemap.runtime.frames.reading import Coordinate
from edgemap.runtime.step.map_file import door_record, pose_record, room_record
from edgemap.runtime.step.map_records import GivenName, Yaw
from edgemap.runtime.step.mapper import START_SIGMAS
from edgemap.view import answers
from edgemap.view.page import LivePage
from edgemap.view.questions import Nothing, Refused, as_json, body_of, named, newest_of, object_json, one_of, take

Side = Annotated[float, Meta(ge=SMALLEST_M, le=LARGEST_M)]
Label = Annotated[str, Meta(min_length=1, max_length=LONGEST_NAME)]


class _Solid(msgspec.Struct, forbid_unknown_fields=True, kw_only=True):
    width_m: Side | None = None
    depth_m: Side | None = None
    height_m: Side | None = None
    yaw_rad: Yaw | None = None


class ObjectRequest(_Solid):
    """Body of PATCH /api/objects/{id}: the fields to change."""

    name: GivenName | None = None
    confirmed: bool | None = None
    label: Label | None = None
    x_m: Coordinate | None = None
    y_m: Coordinate | None = None


class NewObjectRequest(_Solid):
    """Body of POST /api/objects."""

    label: Label
    x_m: Coordinate
    y_m: Coordinate
    name: GivenName = ""


class MergeRequest(msgspec.Struct, forbid_unknown_fields=True):
    """Body of POST /api/objects/{id}/merge."""

    into: GivenName


class ZoneRequest(msgspec.Struct, forbid_unknown_fields=True):
    """Body of POST /api/zones and PUT /api/zones/{id}."""

    name: GivenName
    corners_m: Annotated[list[tuple[Coordinate, Coordinate]], Meta(min_length=3, max_length=MAXIMUM_CORNERS)]


class RoomRequest(msgspec.Struct, forbid_unknown_fields=True):
    """Body of PATCH /api/rooms/{id}."""

    name: GivenName


class DockRequest(msgspec.Struct, forbid_unknown_fields=True):
    """Body of PUT /api/dock: a pose, or `{}` for where the robot is now."""

    x_m: Coordinate | None = None
    y_m: Coordinate | None = None
    yaw_rad: Yaw | None = None

    def pose(self) -> tuple[float, float, float] | None:
        """The pose; None where nothing of it is given. Raises Refused for a part of one."""
        if self.x_m is not None and self.y_m is not None and self.yaw_rad is not None:
            return self.x_m, self.y_m, self.yaw_rad
        if not self.x_m is self.y_m is self.yaw_rad is None:
            raise Refused(400, "a pose is x_m, y_m and yaw_rad together")
        return None


class PoseRequest(DockRequest):
    """Body of PUT /api/pose: a pose, or that the robot is in its dock."""

    in_dock: bool = False
    sigma_m: Annotated[float, Meta(gt=0.0, le=100.0)] = START_SIGMAS[0]
    sigma_yaw_rad: Annotated[float, Meta(gt=0.0, le=math.pi)] = START_SIGMAS[2]


async def add_object(page: LivePage, request: Request) -> Response:
    """Adds an object that was not detected."""
    body = await body_of(request, NewObjectRequest)
    usual = (body.width_m, body.depth_m, body.height_m)
    if any(usual) and not all(usual):
        raise Refused(400, "a size is width_m, depth_m and height_m together")
    size_m = (body.width_m, body.depth_m, body.height_m) if body.width_m and body.depth_m and body.height_m else None
    edit = Edit("add", label=body.label, place_m=(body.x_m, body.y_m), size_m=size_m, yaw_rad=body.yaw_rad)
    identity = await take(page, edit)
    if body.name:
        await take(page, Edit("name", identity, name=body.name))
    return object_json(page, identity, 201)


async def change_object(page: LivePage, request: Request) -> Response:
    """Name an object, confirm it, or correct its class, position, size or facing."""
    body, item = await body_of(request, ObjectRequest), named(page, request)
    if correction := _correction(body, item):
        await take(page, correction)
    if body.name is not None:
        await take(page, Edit("name", item.id, name=body.name))
    if body.confirmed is not None:
        await take(page, Edit("confirm", item.id, on=body.confirmed))
    return object_json(page, item.id)


async def preview_merge(page: LivePage, request: Request) -> Response:
    """Preview of a merge of two objects, without changing the map."""
    item, into = named(page, request), one_of(page.objects, request.query_params.get("into", ""), "object")
    if into.id == item.id:
        raise Refused(409, f"{item.id!r} cannot be merged with itself")
    return as_json(answers.object_answer(joined(into, item), newest_of(page)))


async def delete_object(page: LivePage, request: Request) -> Response:
    """Deletes an object permanently."""
    return as_json({"id": await take(page, Edit("delete", named(page, request).id))})


async def merge_object(page: LivePage, request: Request) -> Response:
    """Merges two objects."""
    body = await body_of(request, MergeRequest)
    one_of(newest_of(page).objects, body.into, "object")
    await take(page, Edit("merge", named(page, request).id, into=body.into))
    return object_json(page, body.into)


async def restore_object(page: LivePage, request: Request) -> Response:
    """Reverts the deletion or merge of an object."""
    await body_of(request, Nothing)
    return as_json({"id": await take(page, Edit("undo", request.path_params["id"]))})


async def put_zone(page: LivePage, request: Request) -> Response:
    """Draw a zone, or change one."""
    body, identity = await body_of(request, ZoneRequest), request.path_params.get("id", "")
    zones = page.annotations.zones
    if identity:
        one_of(zones, identity, "zone")
    # To a person, and in what names them: keep-out, speed, automations.
    taken = {zone.name.strip().casefold(): zone for zone in zones if zone.id != identity}
    if other := taken.get(body.name.strip().casefold()):
        raise Refused(409, f"{other.id} is called {other.name!r} already: give this zone another name")
    made = await take(page, Edit("zone", identity, name=body.name, corners_m=tuple(body.corners_m)))
    zone = next(zone for zone in answers.zones_answer(page.annotations.zones, page.objects) if zone["id"] == made)
    return as_json(zone, 200 if identity else 201)


async def delete_zone(page: LivePage, request: Request) -> Response:
    """Deletes a zone."""
    zone = one_of(page.annotations.zones, request.path_params["id"], "zone")
    return as_json({"id": await take(page, Edit("undo", zone.id))})


async def rooms(page: LivePage, request: Request) -> Response:  # noqa: ARG001
    """The rooms."""
    return as_json([room_record(room) for room in (await _areas(page))[0]])


async def doors(page: LivePage, request: Request) -> Response:  # noqa: ARG001
    """The doors between rooms."""
    return as_json([door_record(door) for door in (await _areas(page))[1]])


async def name_room(page: LivePage, request: Request) -> Response:
    """Names a room, or takes its name away."""
    body, identity = await body_of(request, RoomRequest), request.path_params["id"]
    room = one_of((await _areas(page))[0], identity, "room")
    await take(page, Edit("room", identity, name=body.name, corners_m=room.corners_m))
    return as_json(room_record(one_of((await _areas(page))[0], identity, "room")))


async def _areas(page: LivePage) -> tuple[tuple[Room, ...], tuple[Door, ...]]:
    return await asyncio.to_thread(rooms_of, newest_of(page).objects, page.annotations, page.grid)


async def put_pose(page: LivePage, request: Request) -> Response:
    """Sets the robot's pose."""
    body = await body_of(request, PoseRequest)
    pose, sigmas = body.pose(), (body.sigma_m, body.sigma_m, body.sigma_yaw_rad)
    if pose is None and not body.in_dock:
        raise Refused(400, "give x_m, y_m and yaw_rad together, or in_dock alone")
    await take(page, Edit("pose", "" if pose else "dock", pose=pose, sigmas=sigmas))
    if pose is None:
        return await dock(page, request)
    return as_json(dict(zip(("x_m", "y_m", "yaw_rad"), pose, strict=True)))


async def dock(page: LivePage, request: Request) -> Response:  # noqa: ARG001
    """Pose of the dock."""
    dock = page.annotations.dock
    if dock is None:
        raise Refused(404, "the map has no dock")
    return as_json(pose_record(dock))


async def put_dock(page: LivePage, request: Request) -> Response:
    """Set the dock to a pose, or to where the robot is now."""
    body = await body_of(request, DockRequest)
    here = newest_of(page).result.pose_map_base
    await take(page, Edit("dock", pose=body.pose() or (float(here.x_m), float(here.y_m), float(here.yaw_rad))))
    return await dock(page, request)


async def delete_dock(page: LivePage, request: Request) -> Response:
    """Deletes the dock."""
    await dock(page, request)
    return as_json({"id": await take(page, Edit("undo", "dock"))})


def _correction(body: ObjectRequest, item: MapObject) -> Edit | None:
    """What a body corrects of an object, as an edit; None for nothing. Raises Refused."""
    if (body.x_m is None) != (body.y_m is None):
        raise Refused(400, "a position is x_m and y_m together")
    place_m = None if body.x_m is None or body.y_m is None else (body.x_m, body.y_m)
    size_m, shape = None, item.footprint
    if not body.width_m is body.depth_m is body.height_m is None:
        width_m, depth_m = body.width_m or round(shape.width_m, 3), body.depth_m or round(shape.depth_m, 3)
        size_m = (width_m, depth_m, body.height_m or max(item.height_m, SMALLEST_M))
    if place_m is size_m is body.yaw_rad is body.label is None:
        return None
    return Edit("correct", item.id, label=body.label or "", place_m=place_m, size_m=size_m, yaw_rad=body.yaw_rad)
