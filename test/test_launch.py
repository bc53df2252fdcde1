"""The launch file, loaded by the real launch system where there is one."""

from __future__ import annotations

import runpy
from pathlib import Path

import pytest

from rgbd_glue_ros.config import NodeConfig, parameters

FILE = Path(__file__).resolve().parents[1] / "launch" / "odometry.launch.py"


def test_every_parameter_of_the_node_is_an_argument_of_the_launch_file() -> None:
    pytest.importorskip(
        "launch_ros", reason="launch_ros is not installed (it comes with apt's ROS, not from PyPI)"
    )
    description = runpy.run_path(str(FILE))["generate_launch_description"]()
    names = {argument.name for argument in description.get_launch_arguments()}
    assert {parameter.name for parameter in parameters(NodeConfig())} < names
