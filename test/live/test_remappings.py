"""Remappings of names that no topic has."""

from __future__ import annotations

import pytest

from rgbd_glue_ros.live import topics
from rgbd_glue_ros.live.camera_presets import camera_names, load_camera, remappings
from rgbd_glue_ros.live.remappings import explain_misspelt

NODE = "rgbd_odometry"


@pytest.mark.parametrize(
    ("rule", "meant"),
    [
        ("rgb/imge:=/foo", "rgb/image"),
        ("rgb/Image:=foo", "rgb/image"),
        ("rostopic://depth/imag:=/foo", "depth/image"),
        ("rgbd_odometry:rgb/camera_inf:=/foo", "rgb/camera_info"),
        ("odm:=/foo", "odom"),
    ],
)
def test_a_misspelt_name_is_said_with_the_one_that_is_meant(rule: str, meant: str) -> None:
    (line,) = explain_misspelt(["node", "--ros-args", "-p", "a:=b", "--remap", rule], NODE)
    assert line.startswith(f"{rule}: there is no topic ")
    assert line.endswith(f"did you mean {meant}?")


@pytest.mark.parametrize(
    "rule",
    [
        *(f"{name}:=/foo" for name in topics.NAMES),
        # of other nodes
        "scan:=/foo",
        "other_node:rgb/imge:=/foo",
        "/rgb/imge:=/foo",
        "~/reset:=/foo",
        "__ns:=/robot",
        "__node:=odom2",
        # which ROS refuses
        "rgb/imge",
    ],
)
def test_other_remappings_are_left_alone(rule: str) -> None:
    assert not explain_misspelt(["--ros-args", "-r", rule], NODE)


def test_only_arguments_of_ros_are_looked_at() -> None:
    words = ["-r", "rgb/imge:=a", "--ros-args", "-p", "rgb/imge:=a", "--", "-r", "rgb/imge:=a"]
    assert not explain_misspelt(words, NODE)


@pytest.mark.parametrize("camera", camera_names())
def test_a_camera_preset_remaps_topics_that_there_are(camera: str) -> None:
    rules = [f"{own}:={topic}" for own, topic in remappings(load_camera(camera), {})]
    words = [word for rule in rules for word in ("-r", rule)]
    assert not explain_misspelt(["--ros-args", *words], NODE)
