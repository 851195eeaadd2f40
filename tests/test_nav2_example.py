"""deploy/nav2: the names that each distribution of Nav2 has, its topics and frames by what edgemap publishes."""

import importlib.util
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest
import yaml

from edgemap.bridges.ros2.messages import topics
from edgemap.bridges.ros2.messages.topics import FrameIds

FOLDER = Path(__file__).parents[1] / "deploy" / "nav2"
# What each distribution calls by a name of its own (https://docs.nav2.org/configuration and its migration guides):
# parameters of controller, path follower and behaviours, and what stands between package and class of plugins.
TWO = {"local_costmap_topic", "global_costmap_topic", "local_footprint_topic", "global_footprint_topic", "local_frame"}
OWN: dict[str, tuple[set[str], set[str], set[str], str]] = {
    "humble": (
        {"progress_checker_plugin"}, {"desired_linear_vel", "transform_tolerance"},
        {"costmap_topic", "footprint_topic"}, "/",
    ),
    "jazzy": ({"progress_checker_plugins"}, {"desired_linear_vel", "transform_tolerance"}, TWO, "::"),
    "lyrical": ({"progress_checker_plugins"}, {"max_linear_vel"}, TWO, "::"),
}  # fmt: skip


class Launched:
    """What nav2.launch.py starts: keywords of its nodes by name, and the parameters of each as its files add up."""

    def __init__(self, monkeypatch, distribution, zones=""):
        class Substitution(str):
            def perform(self, context):
                return context[self]

        declared = {"DeclareLaunchArgument": lambda *words, **more: (words, more)}
        actions = SimpleNamespace(**declared, OpaqueFunction=lambda function: function)
        modules: dict[str, Any] = {
            "launch": SimpleNamespace(LaunchContext=dict, LaunchDescription=list),
            "launch.actions": actions,
            "launch.substitutions": SimpleNamespace(LaunchConfiguration=Substitution),
            "launch_ros": ModuleType("launch_ros"),
            "launch_ros.actions": SimpleNamespace(Node=lambda **more: more),
        }
        for name, module in modules.items():
            monkeypatch.setitem(sys.modules, name, module)
        spec = importlib.util.spec_from_file_location("nav2_launch", FOLDER / "nav2.launch.py")
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        *_, function = module.generate_launch_description()
        nodes = function({"distribution": distribution, "zones": str(zones), "params": ""})
        self.nodes = {node["name"]: node for node in nodes}
        self.all: dict[str, Any] = {}
        for part in self.nodes["planner_server"]["parameters"]:
            added(self.all, yaml.safe_load(Path(part).read_text()))

    def of(self, name) -> dict[str, Any]:
        return self.all[name]["ros__parameters"]

    def costmaps(self):
        return [self.all[name][name]["ros__parameters"] for name in ("local_costmap", "global_costmap")]


def added(whole, more):
    for key, value in more.items():
        if isinstance(value, dict):
            added(whole.setdefault(key, {}), value)
        else:
            whole[key] = value


@pytest.fixture
def zones(tmp_path):
    for kind in ("keepout", "speed"):
        (tmp_path / f"zones.{kind}.yaml").touch()
    return tmp_path


@pytest.mark.parametrize("distribution", OWN)
def test_each_distribution_gets_the_names_that_its_nav2_has(distribution, monkeypatch):
    launched = Launched(monkeypatch, distribution)
    *own, separator = OWN[distribution]
    controller, behaving = launched.of("controller_server"), launched.of("behavior_server")
    for row, (given, names) in enumerate(zip((controller, controller["FollowPath"], behaving), own, strict=True)):
        of_others = set().union(*(names[row] for names in OWN.values())) - names
        assert names <= set(given)
        assert not of_others & set(given)
    plugins = [launched.of("planner_server")["GridBased"], *(behaving[one] for one in behaving["behavior_plugins"])]
    names = ("navfn_planner", "NavfnPlanner"), *(("behaviors", one) for one in ("Spin", "BackUp", "Wait"))
    assert [one["plugin"] for one in plugins] == [f"nav2_{package}{separator}{name}" for package, name in names]


def test_its_topics_and_frames_are_those_that_edgemap_publishes(monkeypatch):
    launched, frames = Launched(monkeypatch, "jazzy"), FrameIds()
    ours = [topic for topic in vars(topics).values() if isinstance(topic, topics.Topic)]
    published = {topics.MAP, *(f"/edgemap{topic}" for topic in ours)}
    local, whole = launched.costmaps()
    assert (local["global_frame"], whole["global_frame"]) == (frames.odom, frames.map)
    assert local["robot_base_frame"] == whole["robot_base_frame"] == frames.base
    used = [whole["floor_layer"]["map_topic"], whole["furniture_layer"]["map_topic"]]
    used += [costmap["obstacle_layer"]["floor_scan"]["topic"] for costmap in launched.costmaps()]
    assert set(used) <= published
    assert launched.of("bt_navigator")["odom_topic"] in published


def test_masks_and_filters_run_only_where_there_are_zones(zones, monkeypatch):
    both = Launched(monkeypatch, "jazzy", zones)
    (zones / "zones.speed.yaml").unlink()
    keepout, none = Launched(monkeypatch, "humble", zones), Launched(monkeypatch, "lyrical")
    for launched, kinds in ((both, ["keepout", "speed"]), (keepout, ["keepout"]), (none, [])):
        assert launched.costmaps()[1].get("filters", []) == [f"{kind}_filter" for kind in kinds]
        masks = [name for name in launched.nodes if name.endswith(("mask_server", "info_server"))]
        assert masks == [f"{kind}_{what}_server" for kind in kinds for what in ("mask", "info")]
        manager = launched.nodes["lifecycle_manager_navigation"]["parameters"][0]
        assert manager["node_names"] == [name for name in launched.nodes if name != "lifecycle_manager_navigation"]
    for kind, number in (("keepout", 0), ("speed", 1)):
        info, mask = both.of(f"{kind}_info_server"), both.of(f"{kind}_mask_server")
        assert info["type"] == number
        assert info["mask_topic"] == mask["topic_name"]
        whole = both.costmaps()[1]
        assert whole[f"{kind}_filter"]["filter_info_topic"] == info["filter_info_topic"]
    assert whole["speed_filter"]["speed_limit_topic"].strip("/") == both.of("controller_server")["speed_limit_topic"]
