"""Nav2 on edgemap: `ros2 launch deploy/nav2/nav2.launch.py`, beside `edgemap run … --ros2`.

distribution: humble, jazzy or lyrical, $ROS_DISTRO by default. zones: a folder with zones.keepout.yaml and
zones.speed.yaml, or one of them, as `edgemap map export --format nav2-masks` writes them; those masks and their filters
run too. params: more parameters, which count before these.
"""
# pyright: reportMissingImports=false

import json
import os
import tempfile
from pathlib import Path

from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

HERE = Path(__file__).parent
SERVERS = {
    "controller_server": "nav2_controller",
    "planner_server": "nav2_planner",
    "behavior_server": "nav2_behaviors",
    "bt_navigator": "nav2_bt_navigator",
}


def nodes(context: LaunchContext) -> list[Node]:
    """The servers, and the manager that brings them up in order."""
    distribution, zones, more = (
        LaunchConfiguration(name).perform(context) for name in ("distribution", "zones", "params")
    )
    masks = {kind: Path(zones) / f"zones.{kind}.yaml" for kind in ("keepout", "speed") if zones}
    masks = {kind: mask for kind, mask in masks.items() if mask.is_file()}
    params = [str(HERE / name) for name in ("params.yaml", f"{distribution}.yaml", *["zones.yaml"] * bool(masks))]
    if masks:
        with tempfile.NamedTemporaryFile("w", suffix=".yaml", delete=False) as file:
            filters = {"filters": [f"{kind}_filter" for kind in masks]}
            json.dump({"global_costmap": {"global_costmap": {"ros__parameters": filters}}}, file)  # YAML too
        params.append(file.name)
    params += [more] * bool(more)
    found = [
        Node(package=package, executable=name, name=name, output="screen", parameters=params)
        for name, package in SERVERS.items()
    ]
    managed = list(SERVERS)
    for kind, mask in masks.items():
        server = {"package": "nav2_map_server", "output": "screen"}
        found += [
            Node(executable="map_server", name=f"{kind}_mask_server",
                 parameters=[*params, {"yaml_filename": str(mask)}], **server),
            Node(executable="costmap_filter_info_server", name=f"{kind}_info_server", parameters=params, **server),
        ]  # fmt: skip
        managed += [f"{kind}_mask_server", f"{kind}_info_server"]
    manager = {"autostart": True, "node_names": managed}
    return [
        *found,
        Node(package="nav2_lifecycle_manager", executable="lifecycle_manager", name="lifecycle_manager_navigation",
             output="screen", parameters=[manager]),
    ]  # fmt: skip


def generate_launch_description() -> LaunchDescription:
    """What `ros2 launch` asks for."""
    return LaunchDescription(
        [
            DeclareLaunchArgument("distribution", default_value=os.environ.get("ROS_DISTRO", "jazzy")),
            DeclareLaunchArgument("params", default_value=""),
            DeclareLaunchArgument("zones", default_value=""),
            OpaqueFunction(function=nodes),
        ]
    )
