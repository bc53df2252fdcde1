"""The launch file, loaded by the real launch system where there is one."""

from __future__ import annotations

import runpy
from typing import Any

import pytest
from rigs.paths import ROOT

from rgbd_glue_ros.live.camera_presets import TOPIC_ARGUMENTS, camera_names
from rgbd_glue_ros.parameters import NodeConfig, parameters

pytest.importorskip(
    "launch_ros", reason="launch_ros is not installed (it comes with apt's ROS, not from PyPI)"
)

FILE = ROOT / "launch" / "odometry.launch.py"


def started(**arguments: str) -> list[Any]:
    """The actions of the launch file with these arguments."""
    from launch import LaunchContext

    module = runpy.run_path(str(FILE))
    context = LaunchContext()
    for argument in module["generate_launch_description"]().get_launch_arguments():
        context.launch_configurations[argument.name] = ""
    context.launch_configurations.update(arguments)
    actions: list[Any] = module["actions"](context)
    return actions


def test_every_parameter_of_the_node_is_an_argument_of_the_launch_file() -> None:
    description = runpy.run_path(str(FILE))["generate_launch_description"]()
    names = {argument.name for argument in description.get_launch_arguments()}
    own = {"camera", "namespace", "params_file", "compressed", "use_sim_time"}
    own |= {"bag", "rviz", "mapping"}
    assert names == {p.name for p in parameters(NodeConfig())} | own | set(TOPIC_ARGUMENTS)


@pytest.mark.parametrize("camera", ["", *camera_names()])
def test_only_the_odometry_is_started_for_a_camera_by_default(camera: str) -> None:
    (node,) = started(camera=camera, frame_id="base_link", compressed="true")
    assert node.node_package == "rgbd_glue_ros"
    assert node.node_executable == "odometry"


def test_mapping_is_started_beside_the_odometry_with_the_same_topics_and_parameters(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("launch_ros.actions.Node", type("Node", (dict,), {}))
    given = {"color": "/my/color", "map_file": "room.rgbdmap", "compressed": "true"}
    odometry, mapping = started(mapping="true", **given)
    (alone,) = started(mapping="false", **given)
    assert (odometry["executable"], mapping["executable"]) == ("odometry", "mapping")
    assert odometry["remappings"] == mapping["remappings"] == [("rgb/image", "/my/color")]
    compressed, parameters = mapping["parameters"]
    assert compressed["image_transport"] == "compressed"
    assert set(parameters) == {"map_file", "use_sim_time"}
    for node in (mapping, alone):
        assert [set(part) for part in node["parameters"]] == [set(compressed), set(parameters)]


def test_a_bag_and_rviz_are_started_on_request() -> None:
    assert len(started(bag="drive")) == 2
    assert len(started(bag="drive", rviz="true")) == 3
