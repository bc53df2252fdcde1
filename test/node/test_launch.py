"""The launch file, loaded by the real launch system where there is one, else by a stand-in."""

from __future__ import annotations

import importlib.util
import runpy
import sys
from collections.abc import Mapping
from typing import Any

import pytest
from rigs import launch_stand_in
from rigs.paths import ROOT

from rgbd_glue_ros.live.camera_presets import TOPIC_ARGUMENTS, camera_names, load_camera, remappings
from rgbd_glue_ros.parameters import NodeConfig, parameters

FILE = ROOT / "launch" / "odometry.launch.py"


@pytest.fixture(autouse=True)
def _launch(monkeypatch: pytest.MonkeyPatch) -> None:
    if importlib.util.find_spec("launch_ros") is None:
        for name, module in launch_stand_in.modules().items():
            monkeypatch.setitem(sys.modules, name, module)


@pytest.fixture
def _recorded(monkeypatch: pytest.MonkeyPatch, _launch: None) -> None:
    """Nodes are the words that they are made with."""
    monkeypatch.setattr("launch_ros.actions.Node", type("Node", (dict,), {}))


def launched(**arguments: str) -> tuple[list[Any], Any]:
    """The actions of the launch file with these arguments, and the context that they are for."""
    from launch import LaunchContext

    module = runpy.run_path(str(FILE))
    context = LaunchContext()
    context.launch_configurations.update(arguments)
    for argument in module["generate_launch_description"]().get_launch_arguments():
        argument.execute(context)
    return module["actions"](context), context


def started(**arguments: str) -> list[Any]:
    """The actions of the launch file with these arguments."""
    return launched(**arguments)[0]


def parameters_of(node: Mapping[str, Any], context: Any) -> list[Any]:
    """The files and the values that a node is given, later ones over earlier ones."""
    return [
        part
        if isinstance(part, str)
        else {
            name: value.evaluate(context) if hasattr(value, "evaluate") else value
            for name, value in part.items()
        }
        for part in node["parameters"]
    ]


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


@pytest.mark.parametrize("camera", camera_names())
@pytest.mark.usefixtures("_recorded")
def test_a_camera_gives_the_node_its_topics_and_parameters(camera: str) -> None:
    actions, context = launched(camera=camera, namespace="front")
    (node,) = actions
    assert node["namespace"] == "front"
    assert parameters_of(node, context) == [dict(load_camera(camera).parameters)]
    assert node["remappings"] == remappings(load_camera(camera), {})


@pytest.mark.usefixtures("_recorded")
def test_arguments_override_the_file_and_the_file_the_camera() -> None:
    given = {"frame_id": "base_link", "max_width": "320", "approx_sync_max_interval": "1"}
    actions, context = launched(camera="oak_d", params_file="my.yaml", publish_tf="false", **given)
    preset, file, arguments = parameters_of(actions[0], context)
    assert preset == dict(load_camera("oak_d").parameters)
    assert file == "my.yaml"
    assert arguments == {
        "frame_id": "base_link",
        "max_width": 320,
        "approx_sync_max_interval": 1.0,
        "publish_tf": False,
    }


@pytest.mark.usefixtures("_recorded")
@pytest.mark.parametrize(
    ("arguments", "time"),
    [
        ({}, []),
        ({"use_sim_time": "true"}, [{"use_sim_time": True}]),
        ({"use_sim_time": "false"}, [{"use_sim_time": False}]),
        ({"bag": "drive"}, [{"use_sim_time": True}]),
    ],
)
def test_a_file_decides_about_simulated_time_unless_an_argument_or_a_bag_does(
    arguments: dict[str, str], time: list[dict[str, bool]]
) -> None:
    actions, context = launched(params_file="my.yaml", rviz="true", **arguments)
    odometry, *_, rviz = actions
    assert parameters_of(odometry, context) == ["my.yaml", *time]
    assert parameters_of(rviz, context) == time


def test_a_switch_is_on_or_off_and_a_camera_one_of_the_presets() -> None:
    for arguments in ({"mapping": "yes"}, {"use_sim_time": "1"}, {"camera": "d435"}):
        with pytest.raises(RuntimeError, match=next(iter(arguments))):
            started(**arguments)


@pytest.mark.usefixtures("_recorded")
def test_mapping_is_started_beside_the_odometry_with_the_same_topics_and_parameters() -> None:
    given = {"color": "/my/color", "map_file": "room.rgbdmap", "compressed": "true"}
    odometry, mapping = started(mapping="true", **given)
    (alone,) = started(mapping="false", **given)
    assert (odometry["executable"], mapping["executable"]) == ("odometry", "mapping")
    assert odometry["remappings"] == mapping["remappings"] == [("rgb/image", "/my/color")]
    compressed, parameters = mapping["parameters"]
    assert compressed["image_transport"] == "compressed"
    assert set(parameters) == {"map_file"}
    for node in (mapping, alone):
        assert [set(part) for part in node["parameters"]] == [set(compressed), set(parameters)]


def test_a_bag_and_rviz_are_started_on_request() -> None:
    assert len(started(bag="drive")) == 2
    assert len(started(bag="drive", rviz="true")) == 3
