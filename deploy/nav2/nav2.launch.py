"""Nav2 on edgemap: `ros2 launch deploy/nav2/nav2.launch.py`, beside `edgemap run … --ros2`.

zones: a folder with zones.keepout.yaml and zones.speed.yaml, as `edgemap map export --format nav2-masks` writes them;
where it is given, the masks and their filters run too (params.yaml names the filters).
"""

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
    params = LaunchConfiguration("params").perform(context)
    zones = LaunchConfiguration("zones").perform(context)
    found = [
        Node(package=package, executable=name, name=name, output="screen", parameters=[params])
        for name, package in SERVERS.items()
    ]
    managed = list(SERVERS)
    for kind in ("keepout", "speed"):
        mask = Path(zones) / f"zones.{kind}.yaml"
        if not zones or not mask.is_file():
            continue
        server = {"package": "nav2_map_server", "output": "screen"}
        found += [
            Node(executable="map_server", name=f"{kind}_mask_server",
                 parameters=[params, {"yaml_filename": str(mask)}], **server),
            Node(executable="costmap_filter_info_server", name=f"{kind}_info_server", parameters=[params], **server),
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
            DeclareLaunchArgument("params", default_value=str(HERE / "params.yaml")),
            DeclareLaunchArgument("zones", default_value=""),
            OpaqueFunction(function=nodes),
        ]
    )
