"""`edgemap map approach`: where a robot goes to reach an object of a map."""

from math import degrees
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from edgemap.cli.arguments import arg
from edgemap.cli.options import Json
from edgemap.runtime.frames.errors import BridgeError, UsageError
from edgemap.runtime.frames.option_texts import known_names, numbers
from edgemap.runtime.step.map_store import saved_map

if TYPE_CHECKING:
    from edgemap.geometry.map_object import MapObject
    from edgemap.geometry.se2 import SE2


def command(
    map: Annotated[tyro.conf.Positional[Path], arg(metavar="MAP", help="A map.json, a run folder or a map's name.")],
    object: Annotated[
        tyro.conf.Positional[str | None],
        arg(metavar="ID", help="The object, by its id or its name; or a room, by id, name or kind."),
    ] = None,
    *,
    label: Annotated[str | None, arg(metavar="L", help="The nearest object of this class, instead of ID.")] = None,
    near: Annotated[
        str | None, arg(metavar="X,Y", help="Nearest to this point, metres; the origin by default. The robot is there.")
    ] = None,
    standoff: Annotated[float, arg(metavar="M", help="From the object's edge to the robot's, metres.")] = 0.4,
    robot_radius: Annotated[float, arg(metavar="M", help="Of the circle that holds the robot, metres.")] = 0.25,
    ros2: Annotated[
        bool, arg(help="Publish it on /goal_pose (geometry_msgs/PoseStamped), where Nav2 drives to it.")
    ] = False,
    json: Json = False,
) -> None:
    """A pose from which an object can be approached: before it, facing it, on free floor; or a free pose in a room.

    Free is what the map's grid shows as free, where it has one; other objects are kept clear of. Before the front,
    where a person has set the way the object faces. Map frame: x forward, y left, metres; yaw counter-clockwise.
    """
    from json import dumps

    from edgemap.geometry.objects.approach import ApproachRule, approach, room_pose
    from edgemap.geometry.objects.rooms import room_called, rooms_of, title_of
    from edgemap.runtime.step.grid_file import load_grid
    from edgemap.runtime.step.map_file import goal_record, load_annotated_map, pose_record

    for name, value in (("standoff", standoff), ("robot-radius", robot_radius)):
        if not 0.0 < value <= 10.0:
            raise UsageError(f"--{name} {value:g}: must be above 0 and at most 10 m")
    path = saved_map(map)
    (objects, notes), grid = load_annotated_map(path), load_grid(path)
    named = object is None or any(object in (item.id, item.name) for item in objects)
    room = None if named or label else room_called(rooms_of(objects, notes, grid)[0], object or "")
    rule = ApproachRule(standoff, robot_radius)
    if room is not None and grid is not None:
        pose = room_pose(room, grid, rule)
        record = {"room": room.id, "frame": "map"} | pose_record(pose)
        text = f"{room.id} ({title_of(room)}): x {pose.x_m:.2f} m, y {pose.y_m:.2f} m, on free floor"
    else:
        robot_m = numbers(near, "--near", "X,Y") if near else None
        item = _chosen(objects, object, label, robot_m or [0.0, 0.0])
        goal = approach(item, objects, grid, robot_m, rule)
        pose, record = goal.pose, {"object": item.id, "frame": "map"} | goal_record(goal)
        floor = {"free": "free floor", "unknown": "floor that nobody has seen: check the way"}[goal.floor]
        text = f"{item.id}: x {pose.x_m:.2f} m, y {pose.y_m:.2f} m, yaw {degrees(pose.yaw_rad):.1f} deg; "
        text += f"{goal.standoff_m:.2f} m before it, {floor}"
    if ros2:
        publish_goal(pose)
    print(dumps(record) if json else text + ("; published on /goal_pose" if ros2 else ""))


def _chosen(objects: "list[MapObject]", wanted: str | None, label: str | None, near_m: list[float]) -> "MapObject":
    """The object that is meant. Raises UsageError."""
    from edgemap.geometry.objects.queries import nearest

    if (wanted is None) == (label is None):
        raise UsageError("give the object's ID, or --label L for the nearest of a class")
    if wanted is not None:
        named = [item for item in objects if item.id == wanted] or [item for item in objects if item.name == wanted]
        if len(named) > 1:
            raise UsageError(f"{wanted!r} is the name of {' and '.join(item.id for item in named)}: give an id")
        if not named:
            names = [item.id for item in objects] + [item.name for item in objects if item.name]
            raise UsageError(f"no object {wanted!r} on the map: {known_names([wanted], names, 'it has')}")
        return named[0]
    nearby = nearest(objects, near_m, label, 1)
    if not nearby:
        hint = known_names([label or ""], [item.label for item in objects], "it has")
        raise UsageError(f"--label {label}: no such object on the map; {hint}")
    return nearby[0][1]


def publish_goal(pose: "SE2") -> None:
    """Publishes a goal for a navigation stack. Raises BridgeError where no subscriber appears in time."""
    import time

    from edgemap.bridges.ros2.dds.node import Publisher, shared_node
    from edgemap.bridges.ros2.messages import topics
    from edgemap.bridges.ros2.messages.build import goal_pose

    limit_s = 5.0
    publisher = Publisher(shared_node(), topics.GOAL, topics.GOAL.kind)
    until_s = time.monotonic() + limit_s
    while not publisher.wanted:
        if time.monotonic() > until_s:
            raise BridgeError(f"ROS 2: nobody reads {topics.GOAL} (waited {limit_s:.0f} s): is Nav2 running?")
        time.sleep(0.02)
    time.sleep(0.2)  # the reader has matched us by now, too
    publisher.write(goal_pose(pose, "map", time.time_ns()))
    time.sleep(0.2)  # to be sent before this process ends
