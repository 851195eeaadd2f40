"""The part of the HTTP API that edits: objects, zones, the dock and the robot's pose."""

from __future__ import annotations

import math
from typing import Annotated

import msgspec
from msgspec import Meta
from starlette.requests import Request
from starlette.responses import Response

from edgemap.geometry.objects.corrections import LARGEST_M, SMALLEST_M
from edgemap.geometry.objects.edits import LONGEST_NAME, MAXIMUM_CORNERS, Edit, joined
from edgemap.runtime.frames.reading import Coordinate
from edgemap.runtime.step.map_file import GivenName, Yaw, pose_record
from edgemap.view import answers
from edgemap.view.questions import Answer, Nothing, Questions, Refused, as_json, body_of

Side = Annotated[float, Meta(ge=SMALLEST_M, le=LARGEST_M)]
Label = Annotated[str, Meta(min_length=1, max_length=LONGEST_NAME)]
SIGMA_M, SIGMA_RAD = 0.10, math.radians(3.0)  # of a pose that a person sets, where the body gives none


class ObjectWish(msgspec.Struct, forbid_unknown_fields=True):
    """Body of PATCH /api/objects/{id}: what is to change."""

    name: GivenName | None = None
    confirmed: bool | None = None
    label: Label | None = None
    x_m: Coordinate | None = None
    y_m: Coordinate | None = None
    width_m: Side | None = None
    depth_m: Side | None = None
    height_m: Side | None = None
    yaw_rad: Yaw | None = None


class NewObjectWish(msgspec.Struct, forbid_unknown_fields=True):
    """Body of POST /api/objects."""

    label: Label
    x_m: Coordinate
    y_m: Coordinate
    name: GivenName = ""
    width_m: Side | None = None
    depth_m: Side | None = None
    height_m: Side | None = None
    yaw_rad: Yaw | None = None


class MergeWish(msgspec.Struct, forbid_unknown_fields=True):
    """Body of POST /api/objects/{id}/merge."""

    into: GivenName


class ZoneWish(msgspec.Struct, forbid_unknown_fields=True):
    """Body of POST /api/zones and PUT /api/zones/{id}."""

    name: GivenName
    corners_m: Annotated[list[tuple[Coordinate, Coordinate]], Meta(min_length=3, max_length=MAXIMUM_CORNERS)]


class PoseWish(msgspec.Struct, forbid_unknown_fields=True):
    """Body of PUT /api/pose."""

    x_m: Coordinate
    y_m: Coordinate
    yaw_rad: Yaw
    sigma_m: Annotated[float, Meta(gt=0.0, le=100.0)] = SIGMA_M
    sigma_yaw_rad: Annotated[float, Meta(gt=0.0, le=math.pi)] = SIGMA_RAD


class DockWish(msgspec.Struct, forbid_unknown_fields=True):
    """Body of PUT /api/dock: a pose, or `{}` for where the robot is now."""

    x_m: Coordinate | None = None
    y_m: Coordinate | None = None
    yaw_rad: Yaw | None = None


class EditApi:
    """Answers that edit, for one page."""

    def __init__(self, ask: Questions) -> None:
        self._ask = ask

    def routes(self) -> list[tuple[str, str, Answer]]:
        """Methods and addresses under /api, with what answers them."""
        return [
            ("POST", "/api/objects", self.add_object),
            ("PATCH", "/api/objects/{id}", self.change_object),
            ("DELETE", "/api/objects/{id}", self.delete_object),
            ("GET", "/api/objects/{id}/merge", self.preview_merge),
            ("POST", "/api/objects/{id}/merge", self.merge_object),
            ("POST", "/api/objects/{id}/restore", self.restore_object),
            ("GET", "/api/zones", self.zones),
            ("POST", "/api/zones", self.put_zone),
            ("PUT", "/api/zones/{id}", self.put_zone),
            ("DELETE", "/api/zones/{id}", self.delete_zone),
            ("PUT", "/api/pose", self.put_pose),
            ("GET", "/api/dock", self.dock),
            ("PUT", "/api/dock", self.put_dock),
            ("DELETE", "/api/dock", self.delete_dock),
        ]

    async def add_object(self, request: Request) -> Response:
        """Put an object on the map that nobody has detected."""
        wish = await body_of(request, NewObjectWish)
        usual = (wish.width_m, wish.depth_m, wish.height_m)
        if any(usual) and not all(usual):
            raise Refused(400, "a size is width_m, depth_m and height_m together")
        size_m = (
            (wish.width_m, wish.depth_m, wish.height_m) if wish.width_m and wish.depth_m and wish.height_m else None
        )
        edit = Edit("add", label=wish.label, place_m=(wish.x_m, wish.y_m), size_m=size_m, yaw_rad=wish.yaw_rad)
        identity = await self._ask.edit(edit)
        if wish.name:
            await self._ask.edit(Edit("rename", identity, name=wish.name))
        return as_json(self._ask.find(identity), 201)

    async def change_object(self, request: Request) -> Response:
        """Name an object, confirm it, or correct its class, position, size or facing."""
        wish, item = await body_of(request, ObjectWish), self._ask.object(request)
        correction = _correction(wish, item)
        if correction is not None:
            await self._ask.edit(correction)
        if wish.name is not None:
            await self._ask.edit(Edit("rename", item["id"], name=wish.name))
        if wish.confirmed is not None:
            await self._ask.edit(Edit("confirm", item["id"], on=wish.confirmed))
        return as_json(self._ask.object(request))

    async def preview_merge(self, request: Request) -> Response:
        """What two objects would be as one: nothing is changed."""
        item, into = self._ask.object(request)["id"], request.query_params.get("into", "")
        if self._ask.find(into)["id"] == item:
            raise Refused(409, f"{item!r} cannot be merged with itself")
        found = {one.id: one for one in self._ask.page.objects}
        return as_json(answers.object_answer(joined([found[into], found[item]]), self._ask.moment()))

    async def delete_object(self, request: Request) -> Response:
        """Take an object off the map, and keep it off."""
        return as_json({"id": await self._ask.edit(Edit("delete", self._ask.object(request)["id"]))})

    async def merge_object(self, request: Request) -> Response:
        """Say that two objects are one."""
        wish = await body_of(request, MergeWish)
        self._ask.find(wish.into)
        await self._ask.edit(Edit("merge", self._ask.object(request)["id"], into=wish.into))
        return as_json(self._ask.find(wish.into))

    async def restore_object(self, request: Request) -> Response:
        """Take back that an object was deleted or merged."""
        await body_of(request, Nothing)
        return as_json({"id": await self._ask.edit(Edit("restore", request.path_params["id"]))})

    async def zones(self, request: Request) -> Response:  # noqa: ARG002
        """The zones, with the objects in each."""
        return as_json(answers.zones_answer(self._ask.page))

    async def put_zone(self, request: Request) -> Response:
        """Draw a zone, or change one."""
        wish, identity = await body_of(request, ZoneWish), request.path_params.get("id", "")
        if identity and identity not in {zone.id for zone in self._ask.page.annotations.zones}:
            raise Refused(404, f"no zone {identity[:60]!r}")
        made = await self._ask.edit(Edit("zone", identity, name=wish.name, corners_m=tuple(wish.corners_m)))
        zone = next(zone for zone in answers.zones_answer(self._ask.page) if zone["id"] == made)
        return as_json(zone, 200 if identity else 201)

    async def delete_zone(self, request: Request) -> Response:
        """Take a zone away."""
        identity = request.path_params["id"]
        if identity not in {zone.id for zone in self._ask.page.annotations.zones}:
            raise Refused(404, f"no zone {identity[:60]!r}")
        return as_json({"id": await self._ask.edit(Edit("drop_zone", identity))})

    async def put_pose(self, request: Request) -> Response:
        """Say where the robot is."""
        wish = await body_of(request, PoseWish)
        sigmas = (wish.sigma_m, wish.sigma_m, wish.sigma_yaw_rad)
        await self._ask.edit(Edit("pose", pose=(wish.x_m, wish.y_m, wish.yaw_rad), sigmas=sigmas))
        return as_json({"x_m": wish.x_m, "y_m": wish.y_m, "yaw_rad": wish.yaw_rad})

    async def dock(self, request: Request) -> Response:  # noqa: ARG002
        """Where the dock is."""
        dock = self._ask.page.annotations.dock
        if dock is None:
            raise Refused(404, "the map has no dock")
        return as_json(pose_record(dock))

    async def put_dock(self, request: Request) -> Response:
        """Set the dock to a pose, or to where the robot is now."""
        wish = await body_of(request, DockWish)
        here = self._ask.moment().result.pose_map_base
        pose = (float(here.x_m), float(here.y_m), float(here.yaw_rad))
        if wish.x_m is not None and wish.y_m is not None and wish.yaw_rad is not None:
            pose = (wish.x_m, wish.y_m, wish.yaw_rad)
        elif wish != DockWish():
            raise Refused(400, "a dock is x_m, y_m and yaw_rad together, or {} for the robot's pose now")
        await self._ask.edit(Edit("dock", pose=pose))
        return await self.dock(request)

    async def delete_dock(self, request: Request) -> Response:
        """Take the dock off the map."""
        await self.dock(request)
        return as_json({"id": await self._ask.edit(Edit("drop_dock"))})


def _correction(wish: ObjectWish, item: dict) -> Edit | None:
    """What a body corrects of an object, as an edit; None for nothing. Raises Refused."""
    if (wish.x_m is None) != (wish.y_m is None):
        raise Refused(400, "a position is x_m and y_m together")
    place_m = None if wish.x_m is None or wish.y_m is None else (wish.x_m, wish.y_m)
    size_m = None
    if not wish.width_m is wish.depth_m is wish.height_m is None:
        width_m, depth_m = item["footprint_m"]
        size_m = (wish.width_m or width_m, wish.depth_m or depth_m, wish.height_m or max(item["height_m"], SMALLEST_M))
    if place_m is size_m is wish.yaw_rad is wish.label is None:
        return None
    return Edit("correct", item["id"], label=wish.label or "", place_m=place_m, size_m=size_m, yaw_rad=wish.yaw_rad)
