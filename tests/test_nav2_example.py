"""deploy/nav2: its parameters by Nav2's documented names, its topics and frames by what edgemap publishes."""

import ast
from pathlib import Path

import yaml

from edgemap.bridges.ros2.messages import topics
from edgemap.bridges.ros2.messages.topics import FrameIds

FOLDER = Path(__file__).parents[1] / "deploy" / "nav2"
PARAMS = yaml.safe_load((FOLDER / "params.yaml").read_text())
# By https://docs.nav2.org/configuration/index.html and nav2_bringup's own parameters (Humble to Jazzy).
COSTMAP = {
    "update_frequency", "publish_frequency", "global_frame", "robot_base_frame", "rolling_window", "width", "height",
    "resolution", "robot_radius", "transform_tolerance", "plugins", "filters", "track_unknown_space",
}  # fmt: skip
LAYERS = {
    "nav2_costmap_2d::StaticLayer": {"map_topic", "map_subscribe_transient_local", "use_maximum", "enabled"},
    "nav2_costmap_2d::ObstacleLayer": {"enabled", "observation_sources", "floor_scan"},
    "nav2_costmap_2d::InflationLayer": {"cost_scaling_factor", "inflation_radius", "enabled"},
    "nav2_costmap_2d::KeepoutFilter": {"enabled", "filter_info_topic"},
    "nav2_costmap_2d::SpeedFilter": {"enabled", "filter_info_topic", "speed_limit_topic"},
}
SOURCE = {
    "topic", "data_type", "marking", "clearing", "inf_is_valid", "min_obstacle_height", "max_obstacle_height",
    "obstacle_max_range", "raytrace_max_range",
}  # fmt: skip
SERVERS = {
    "bt_navigator": {"global_frame", "robot_base_frame", "odom_topic", "bt_loop_duration", "default_server_timeout"},
    "controller_server": {
        "controller_frequency", "min_x_velocity_threshold", "min_theta_velocity_threshold", "failure_tolerance",
        "progress_checker_plugins", "goal_checker_plugins", "controller_plugins", "speed_limit_topic",
        "progress_checker", "general_goal_checker", "FollowPath",
    },
    "planner_server": {"expected_planner_frequency", "planner_plugins", "GridBased"},
    "behavior_server": {
        "costmap_topic", "footprint_topic", "cycle_frequency", "behavior_plugins", "spin", "backup", "wait",
        "global_frame", "robot_base_frame", "transform_tolerance", "simulate_ahead_time", "max_rotational_vel",
        "min_rotational_vel", "rotational_acc_lim",
    },
    "keepout_mask_server": {"yaml_filename", "topic_name", "frame_id"},
    "speed_mask_server": {"yaml_filename", "topic_name", "frame_id"},
    "keepout_info_server": {"type", "filter_info_topic", "mask_topic", "base", "multiplier"},
    "speed_info_server": {"type", "filter_info_topic", "mask_topic", "base", "multiplier"},
}  # fmt: skip
FOLLOW_PATH = {
    "plugin", "desired_linear_vel", "lookahead_dist", "min_lookahead_dist", "max_lookahead_dist",
    "rotate_to_heading_angular_vel", "max_angular_accel", "use_rotate_to_heading", "transform_tolerance",
    "use_collision_detection",
}  # fmt: skip


def parameters(name):
    return PARAMS[name]["ros__parameters"]


def costmaps():
    return [PARAMS[name][name]["ros__parameters"] for name in ("local_costmap", "global_costmap")]


def test_every_parameter_is_one_that_nav2_documents():
    assert set(PARAMS) == set(SERVERS) | {"local_costmap", "global_costmap"}
    for name, known in SERVERS.items():
        assert set(parameters(name)) <= known, name
    assert set(parameters("controller_server")["FollowPath"]) <= FOLLOW_PATH
    for costmap in costmaps():
        layers = [*costmap["plugins"], *costmap.get("filters", [])]
        assert set(costmap) <= COSTMAP | set(layers)
        for layer in layers:
            own = costmap[layer]
            assert set(own) <= LAYERS[own["plugin"]] | {"plugin"}, layer
            assert set(own.get("floor_scan", {})) <= SOURCE


def test_its_topics_and_frames_are_those_that_edgemap_publishes():
    frames = FrameIds()
    published = {topics.MAP, *(f"/edgemap{topic}" for topic in topics.KINDS)}
    local, whole = costmaps()
    assert (local["global_frame"], whole["global_frame"]) == (frames.odom, frames.map)
    assert local["robot_base_frame"] == whole["robot_base_frame"] == frames.base
    used = [whole["floor_layer"]["map_topic"], whole["furniture_layer"]["map_topic"]]
    used += [costmap["obstacle_layer"]["floor_scan"]["topic"] for costmap in costmaps()]
    assert set(used) <= published
    assert parameters("bt_navigator")["odom_topic"] in published


def test_filters_masks_and_servers_belong_together():
    _, whole = costmaps()
    for kind, number in (("keepout", 0), ("speed", 1)):
        info, mask = parameters(f"{kind}_info_server"), parameters(f"{kind}_mask_server")
        assert info["type"] == number
        assert info["mask_topic"] == mask["topic_name"]
        assert whole[f"{kind}_filter"]["filter_info_topic"] == info["filter_info_topic"]
        assert mask["yaml_filename"] == f"zones.{kind}.yaml"  # as `map export --format nav2-masks` names it
    assert whole["speed_filter"]["speed_limit_topic"].strip("/") == parameters("controller_server")["speed_limit_topic"]


def test_the_launch_file_starts_what_the_parameters_describe():
    tree = ast.parse((FOLDER / "nav2.launch.py").read_text())
    (servers,) = [
        ast.literal_eval(node.value)
        for node in tree.body
        if isinstance(node, ast.Assign) and getattr(node.targets[0], "id", "") == "SERVERS"
    ]
    assert set(servers) == {name for name in SERVERS if not name.endswith(("mask_server", "info_server"))}
    assert any(isinstance(node, ast.FunctionDef) and node.name == "generate_launch_description" for node in tree.body)
