"""The HTTP API's goal poses: poses from which objects can be approached."""

from typing import Any

from starlette.requests import Request
from starlette.responses import Response

from edgemap.geometry.errors import MapError
from edgemap.geometry.objects.approach import Approach, ApproachRule, approach
from edgemap.runtime.step.map_file import pose_record
from edgemap.view.questions import Answer, Nothing, Questions, Refused, as_json, body_of

USUAL = ApproachRule()
FARTHEST_M = 10.0  # of a standoff or a robot's radius


class ApproachApi:
    """Answers for one page."""

    def __init__(self, ask: Questions) -> None:
        self._ask = ask

    def routes(self) -> list[tuple[str, str, Answer]]:
        """Methods and addresses under /api, with what answers them."""
        return [
            ("GET", "/api/objects/{id}/approach", self.approach),
            ("POST", "/api/objects/{id}/go", self.go),
        ]

    async def approach(self, request: Request) -> Response:
        """The goal pose for an object."""
        return as_json(self._record(request, self._found(request)))

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
        return as_json(self._record(request, goal))

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

    def _record(self, request: Request, goal: Approach) -> dict[str, Any]:
        own = {"object": request.path_params["id"], "standoff_m": round(goal.standoff_m, 3), "floor": goal.floor}
        return own | pose_record(goal.pose)


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
