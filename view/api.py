"""The HTTP API of a run: its map and its state, for any program. docs/http-api.md documents it."""

import asyncio
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import msgspec
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import Route

from edgemap.geometry.errors import GeometryError, MapError
from edgemap.geometry.objects.approach import Approach, ApproachRule, approach
from edgemap.runtime.step.map_file import pose_record
from edgemap.view import answers
from edgemap.view.edit_api import EditApi
from edgemap.view.page import LivePage
from edgemap.view.questions import Answer, Nothing, Questions, Refused, as_json, body_of, guarded
from edgemap.view.updates import Pictures, ProcessUsage

USUAL = ApproachRule()  # for goal poses
FARTHEST_M = 10.0  # of a standoff or a robot's radius
OPENAPI = Path(__file__).parent / "openapi.yaml"


class PauseRequest(msgspec.Struct, forbid_unknown_fields=True):
    """Body of POST /api/pause."""

    paused: bool


class MountRequest(msgspec.Struct, forbid_unknown_fields=True):
    """Body of PUT /api/mount."""

    height_m: Annotated[float, msgspec.Meta(ge=0.05, le=3.0)]
    pitch_deg: Annotated[float, msgspec.Meta(ge=-45.0, le=85.0)]


class Api:
    """Answers for one page. Every failure is JSON with one line: `{"error": "…"}`."""

    def __init__(self, page: LivePage, pictures: Pictures, usage: ProcessUsage) -> None:
        self._ask, self._pictures, self._usage = Questions(page), pictures, usage
        self._editing = EditApi(self._ask)

    def routes(self) -> list[Route]:
        """All addresses under /api."""
        routes: list[tuple[str, str, Answer]] = [
            *(("GET", f"/api/{name}", _reading(state)) for name, state in self._states().items()),
            ("GET", "/api/picture", self.picture),
            ("GET", "/api/map", self.map),
            ("GET", "/api/rooms", self.rooms),
            ("GET", "/api/objects/{id}", self.object),
            ("GET", "/api/objects/{id}/picture", self.object_picture),
            ("GET", "/api/objects/{id}/approach", self.approach),
            ("POST", "/api/objects/{id}/go", self.go),
            ("POST", "/api/pause", self.pause),
            ("POST", "/api/save", self.save),
            ("PUT", "/api/mount", self.put_mount),
            ("GET", "/api/openapi.yaml", self.openapi),
        ]
        routes += self._editing.routes()
        return [Route(path, guarded(answer), methods=[method]) for method, path, answer in routes]

    def _states(self) -> dict[str, Callable[[], object]]:
        """What a GET without parameters reads, by its name under /api."""
        ask, page = self._ask, self._ask.page
        return {
            "run": lambda: page.about | {"state": page.state},
            "health": lambda: answers.health_answer(page, self._usage.now()),
            "faults": lambda: [answers.fault_answer(fault) for fault in page.faults.all()],
            "events": lambda: [answers.event_answer(event) for event in page.events.all()],
            "pose": lambda: answers.pose_answer(ask.snapshot().result),
            "frame": lambda: answers.frame_answer(ask.snapshot().result),
            "floor": lambda: answers.floor_answer(ask.snapshot().result.grid),
            "objects": lambda: answers.objects_answer(page.newest),
            "zones": lambda: answers.zones_answer(page),
        }

    async def picture(self, request: Request) -> Response:  # noqa: ARG002
        """The newest picture."""
        frame = self._ask.snapshot().result.frame
        return Response(self._pictures.jpeg(frame), media_type="image/jpeg", headers={"X-Frame": str(frame.index)})

    async def map(self, request: Request) -> Response:  # noqa: ARG002
        """The map as the run folder's map.json."""
        headers = {"Content-Disposition": 'attachment; filename="map.json"'}
        return Response(self._ask.page.map_text(), media_type="application/json", headers=headers)

    async def rooms(self, request: Request) -> Response:  # noqa: ARG002
        """The rooms that walls and doors close, the largest first; POST /api/zones names one."""
        return as_json(await asyncio.to_thread(answers.rooms_answer, self._ask.snapshot().result.grid))

    async def object(self, request: Request) -> Response:
        """One object."""
        return as_json(self._ask.object(request))

    async def object_picture(self, request: Request) -> Response:
        """The best picture of an object that this run has."""
        identity = self._ask.object(request)["id"]
        crop = self._ask.page.crops.of([identity]).get(identity)
        if crop is None:
            raise Refused(404, f"no picture of {identity} yet: it was not seen by this run")
        return Response(crop.jpeg, media_type="image/jpeg", headers={"X-Frame": str(crop.frame)})

    async def pause(self, request: Request) -> Response:
        """Hold or resume a run of files."""
        body = await body_of(request, PauseRequest)
        if self._ask.page.pause is None:
            raise Refused(409, "the camera is live: it cannot be paused")
        if self._ask.page.state == "finished":
            raise Refused(409, "the run is over")
        self._ask.page.set_paused(body.paused)
        return as_json({"state": self._ask.page.state})

    async def save(self, request: Request) -> Response:
        """Saves a copy of the map in the run folder."""
        await body_of(request, Nothing)
        return as_json({"path": str(await asyncio.to_thread(self._ask.page.save))})

    async def put_mount(self, request: Request) -> Response:
        """Saves a mount in the run's camera.yaml, for the next run."""
        body, page = await body_of(request, MountRequest), self._ask.page
        if page.keep_mount is None:
            raise Refused(409, "this run keeps no camera.yaml")
        try:
            path = await asyncio.to_thread(page.keep_mount, body.height_m, body.pitch_deg)
        except GeometryError as error:
            raise Refused(400, str(error)) from None
        page.about["mount"] |= {"height_m": body.height_m, "pitch_deg": body.pitch_deg}
        return as_json({"path": str(path)})

    async def openapi(self, request: Request) -> Response:  # noqa: ARG002
        """This API as OpenAPI text."""
        return Response(OPENAPI.read_bytes(), media_type="application/yaml")

    async def approach(self, request: Request) -> Response:
        """The goal pose for an object."""
        return as_json(self._goal(request, self._found(request)))

    async def go(self, request: Request) -> Response:
        """Send the robot there: publishes the pose as a goal."""
        await body_of(request, Nothing)
        page = self._ask.page
        goal = self._found(request)
        if not page.goals:
            raise Refused(409, "nobody takes goals: run with --ros2, where Nav2 reads /goal_pose")
        if page.state != "running":
            raise Refused(409, f"the run is {page.state}: goals are published with its steps")
        for send in page.goals:
            send(goal.pose)
        return as_json(self._goal(request, goal))

    def _found(self, request: Request) -> Approach:
        identity, snapshot = self._ask.object(request)["id"], self._ask.snapshot()
        rule = ApproachRule(
            _metres(request, "standoff_m", USUAL.standoff_m),
            _metres(request, "robot_radius_m", USUAL.robot_radius_m),
        )
        pose = snapshot.result.pose_map_base
        item = next(item for item in snapshot.objects if item.id == identity)
        try:
            return approach(item, snapshot.objects, self._ask.page.grid, (pose.x_m, pose.y_m), rule)
        except MapError as error:
            raise Refused(409, str(error)) from None

    def _goal(self, request: Request, goal: Approach) -> dict[str, Any]:
        own = {"object": request.path_params["id"], "standoff_m": round(goal.standoff_m, 3), "floor": goal.floor}
        return own | pose_record(goal.pose)


def _reading(state: Callable[[], object]) -> Answer:
    """Answers with a state as JSON."""

    async def answer(request: Request) -> Response:  # noqa: ARG001
        return as_json(state())

    return answer


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
