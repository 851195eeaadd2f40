"""The HTTP API of a run: its map and its state, for any program. docs/http-api.md documents it."""

import asyncio
from collections.abc import Awaitable, Callable
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import msgspec
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import Route

from edgemap.geometry.errors import GeometryError, MapError
from edgemap.geometry.objects.approach import Approach, ApproachRule, approach
from edgemap.runtime.frames.limits import HIGHEST_M, LOWEST_M
from edgemap.runtime.step.map_file import goal_record
from edgemap.view import answers
from edgemap.view import edit_routes as edits
from edgemap.view.page import LivePage
from edgemap.view.questions import Nothing, Refused, as_json, body_of, named, newest_of, object_json
from edgemap.view.updates import ProcessUsage, shown_jpeg

USUAL = ApproachRule()  # for goal poses
FARTHEST_M = 10.0  # of a standoff or a robot's radius
OPENAPI = Path(__file__).parent / "openapi.yaml"


class PauseRequest(msgspec.Struct, forbid_unknown_fields=True):
    """Body of POST /api/pause."""

    paused: bool


class MountRequest(msgspec.Struct, forbid_unknown_fields=True):
    """Body of PUT /api/mount."""

    height_m: Annotated[float, msgspec.Meta(ge=LOWEST_M, le=HIGHEST_M)]
    pitch_deg: Annotated[float, msgspec.Meta(ge=-45.0, le=85.0)]


def api_routes(page: LivePage, usage: ProcessUsage) -> list[Route]:
    """All addresses under /api, for one page. Every failure is JSON with one line: `{"error": "…"}`."""
    states: dict[str, Callable[[], object]] = {  # what a GET without parameters reads
        "run": lambda: page.about | {"state": page.state},
        "health": lambda: answers.health_answer(page, usage.now()),
        "faults": lambda: [answers.fault_answer(fault) for fault in page.faults.all()],
        "events": lambda: [answers.event_answer(event) for event in page.events.all()],
        "pose": lambda: answers.pose_answer(newest_of(page).result),
        "frame": lambda: answers.frame_answer(newest_of(page).result),
        "floor": lambda: answers.floor_answer(newest_of(page).result.grid),
        "objects": lambda: answers.objects_answer(page.newest),
        "changes": lambda: answers.changes_answer(page.objects, page.annotations),
        "zones": lambda: answers.zones_answer(page.annotations.zones, page.objects),
    }
    routes = [Route(f"/api/{name}", partial(_read, state), methods=["GET"]) for name, state in states.items()]
    return routes + [Route(path, partial(answer, page), methods=[method]) for method, path, answer in ANSWERS]


async def _read(state: Callable[[], object], request: Request) -> Response:  # noqa: ARG001
    """A state as JSON."""
    return as_json(state())


async def picture(page: LivePage, request: Request) -> Response:  # noqa: ARG001
    """The newest picture."""
    frame = newest_of(page).result.frame
    _must_show(page)
    return Response(shown_jpeg(frame), media_type="image/jpeg", headers={"X-Frame": str(frame.index)})


def _must_show(page: LivePage) -> None:
    """Raises Refused where no picture may leave."""
    if not page.pictures:
        raise Refused(403, "this run shows no pictures (--view …,without-pictures)")


async def saved_map(page: LivePage, request: Request) -> Response:  # noqa: ARG001
    """The map as the run folder's map.json."""
    headers = {"Content-Disposition": 'attachment; filename="map.json"'}
    return Response(page.map_text(), media_type="application/json", headers=headers)


async def one_object(page: LivePage, request: Request) -> Response:
    """One object."""
    return object_json(page, request.path_params["id"])


async def object_picture(page: LivePage, request: Request) -> Response:
    """The best picture of an object that this run has."""
    identity = named(page, request).id
    _must_show(page)
    crop = page.crops.of([identity]).get(identity)
    if crop is None:
        raise Refused(404, f"no picture of {identity} yet: it was not seen by this run")
    return Response(crop.jpeg, media_type="image/jpeg", headers={"X-Frame": str(crop.frame)})


async def pause(page: LivePage, request: Request) -> Response:
    """Hold or resume a run of files."""
    body = await body_of(request, PauseRequest)
    if page.pause is None:
        raise Refused(409, "the camera is live: it cannot be paused")
    if page.state == "finished":
        raise Refused(409, "the run is over")
    page.set_paused(body.paused)
    return as_json({"state": page.state})


async def save(page: LivePage, request: Request) -> Response:
    """Saves a copy of the map in the run folder."""
    await body_of(request, Nothing)
    return as_json({"path": str(await asyncio.to_thread(page.save))})


async def put_mount(page: LivePage, request: Request) -> Response:
    """Saves a mount in the run's camera.yaml, for the next run."""
    body = await body_of(request, MountRequest)
    if page.keep_mount is None:
        raise Refused(409, "this run keeps no camera.yaml")
    try:
        path = await asyncio.to_thread(page.keep_mount, body.height_m, body.pitch_deg)
    except GeometryError as error:
        raise Refused(400, str(error)) from None
    page.about["mount"] |= {"height_m": body.height_m, "pitch_deg": body.pitch_deg}
    return as_json({"path": str(path)})


async def openapi(page: LivePage, request: Request) -> Response:  # noqa: ARG001
    """This API as OpenAPI text."""
    return Response(OPENAPI.read_bytes(), media_type="application/yaml")


async def goal_pose(page: LivePage, request: Request) -> Response:
    """The goal pose for an object."""
    return as_json(_goal(request, _found(page, request)))


async def go(page: LivePage, request: Request) -> Response:
    """Send the robot there: publishes the pose as a goal."""
    await body_of(request, Nothing)
    goal = _found(page, request)
    if not page.goals:
        raise Refused(409, "nobody takes goals: run with --ros2, where Nav2 reads /goal_pose")
    if page.state != "running":
        raise Refused(409, f"the run is {page.state}: goals are published with its steps")
    for send in page.goals:
        send(goal.pose)
    return as_json(_goal(request, goal))


def _found(page: LivePage, request: Request) -> Approach:
    item, snapshot = named(page, request), newest_of(page)
    rule = ApproachRule(
        _metres(request, "standoff_m", USUAL.standoff_m),
        _metres(request, "robot_radius_m", USUAL.robot_radius_m),
    )
    pose = snapshot.result.pose_map_base
    try:
        return approach(item, snapshot.objects, page.grid, (pose.x_m, pose.y_m), rule)
    except MapError as error:
        raise Refused(409, str(error)) from None


def _goal(request: Request, goal: Approach) -> dict[str, Any]:
    return {"object": request.path_params["id"]} | goal_record(goal)


def _metres(request: Request, name: str, usual: float) -> float:
    """A length from the address. Raises Refused."""
    text = request.query_params.get(name)
    if text is None:
        return usual
    try:
        value = float(text)
    except ValueError:
        value = -1.0
    if not 0.0 < value <= FARTHEST_M:
        raise Refused(400, f"{name}: above 0 and at most {FARTHEST_M:g} m")
    return value


# Method, address and what answers.
ANSWERS: list[tuple[str, str, Callable[[LivePage, Request], Awaitable[Response]]]] = [
    ("GET", "/api/picture", picture),
    ("GET", "/api/map", saved_map),
    ("GET", "/api/rooms", edits.rooms),
    ("PATCH", "/api/rooms/{id}", edits.name_room),
    ("GET", "/api/doors", edits.doors),
    ("GET", "/api/objects/{id}", one_object),
    ("GET", "/api/objects/{id}/picture", object_picture),
    ("GET", "/api/objects/{id}/approach", goal_pose),
    ("POST", "/api/objects/{id}/go", go),
    ("POST", "/api/pause", pause),
    ("POST", "/api/save", save),
    ("PUT", "/api/mount", put_mount),
    ("GET", "/api/openapi.yaml", openapi),
    ("POST", "/api/objects", edits.add_object),
    ("PATCH", "/api/objects/{id}", edits.change_object),
    ("DELETE", "/api/objects/{id}", edits.delete_object),
    ("GET", "/api/objects/{id}/merge", edits.preview_merge),
    ("POST", "/api/objects/{id}/merge", edits.merge_object),
    ("POST", "/api/objects/{id}/restore", edits.restore_object),
    ("POST", "/api/zones", edits.put_zone),
    ("PUT", "/api/zones/{id}", edits.put_zone),
    ("DELETE", "/api/zones/{id}", edits.delete_zone),
    ("PUT", "/api/pose", edits.put_pose),
    ("GET", "/api/dock", edits.dock),
    ("PUT", "/api/dock", edits.put_dock),
    ("DELETE", "/api/dock", edits.delete_dock),
]
