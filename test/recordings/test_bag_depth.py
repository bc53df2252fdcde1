"""Bags whose depth was taken by another camera than colour."""

from __future__ import annotations

import logging
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rigs.bags import CAMERA, COLOR, INFO, Recorded, write_rosbag1, write_rosbag2
from rosbags.typesys import Stores, get_typestore

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.messages.making import (
    camera_info,
    color_image,
    depth_image,
    header,
    pose_stamped,
)
from rgbd_glue_ros.parameters import InputConfig
from rgbd_glue_ros.recordings import open_recording
from rgbd_glue_ros.recordings.bag.recording import BagRecording, Topics
from rgbd_glue_ros.recordings.calibration import Calibration
from rgbd_glue_ros.types import CameraIntrinsics, Float64

TYPES: Any = get_typestore(Stores.ROS2_JAZZY).types
DEPTH, DEPTH_INFO = "/camera/depth/image", "/camera/depth/camera_info"
DEPTH_CAMERA = CameraIntrinsics(80, 60, 70.0, 70.0, 39.5, 29.5)
NARROW_CAMERA = CameraIntrinsics(80, 60, 140.0, 140.0, 39.5, 29.5)
STAMP_NS = 1_300_000_000_000_000_001
# the depth camera is half a metre behind the colour camera, two steps down the tree
T_LINK_COLOR, T_LINK_DEPTH = np.eye(4), np.eye(4)
T_LINK_COLOR[2, 3], T_LINK_DEPTH[2, 3] = 0.3, -0.2


def static_transform(child: str, T_link_child: Float64) -> Recorded:
    pose = pose_stamped(T_link_child, header(0, "camera_link"))
    position, orientation = pose.pose.position, pose.pose.orientation
    vector = TYPES["geometry_msgs/msg/Vector3"](position.x, position.y, position.z)
    quaternion = TYPES["geometry_msgs/msg/Quaternion"](
        orientation.x, orientation.y, orientation.z, orientation.w
    )
    transform = TYPES["geometry_msgs/msg/Transform"](vector, quaternion)
    stamped = TYPES["geometry_msgs/msg/TransformStamped"](pose.header, child, transform)
    message = TYPES["tf2_msgs/msg/TFMessage"]([stamped])
    return Recorded("/tf_static", "tf2_msgs/msg/TFMessage", STAMP_NS, message)


def recorded(depth_frame: str, camera: CameraIntrinsics = DEPTH_CAMERA) -> list[Recorded]:
    """A wall at 2 m from the depth camera, seen by both."""
    head, depth_head = header(STAMP_NS, "color_optical"), header(STAMP_NS, depth_frame)
    color = color_image(np.zeros((48, 64), np.uint8), head)
    depth = depth_image(np.full((60, 80), 2.0, np.float32), depth_head)
    return [
        Recorded(COLOR, "sensor_msgs/msg/Image", STAMP_NS, color),
        Recorded(DEPTH, "sensor_msgs/msg/Image", STAMP_NS, depth),
        Recorded(INFO, "sensor_msgs/msg/CameraInfo", STAMP_NS, camera_info(CAMERA, head)),
        Recorded(
            DEPTH_INFO,
            "sensor_msgs/msg/CameraInfo",
            STAMP_NS,
            camera_info(camera, depth_head),
        ),
    ]


PLACES = [
    static_transform("color_optical", T_LINK_COLOR),
    static_transform("depth_optical", T_LINK_DEPTH),
]


def test_depth_of_another_camera_is_registered_by_its_info_and_the_static_transforms(
    tmp_path: Path,
) -> None:
    bag = write_rosbag2(tmp_path / "bag", [*PLACES, *recorded("depth_optical")])
    with BagRecording(bag) as sequence:
        (frame,) = sequence
    assert frame.depth.shape == frame.color.shape == (48, 64)
    np.testing.assert_allclose(frame.depth[10:-10, 10:-10], 1.5, rtol=1e-5)


def test_an_only_info_that_is_damaged_is_ignored_unless_it_was_given(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    info = recorded("only_here")[-1]
    bag = write_rosbag1(tmp_path / "latched.bag", [*without_info("depth_optical"), info])
    content = bytearray(bag.read_bytes())
    # number and stamp of the header, and the length of its frame's name, are before that name
    size = content.index(b"only_here") - 16 - 4
    content[size : size + 4] = b"\xff" * 4
    bag.write_bytes(content)
    with BagRecording(bag) as sequence, pytest.raises(InputError, match="chunks are damaged"):
        list(sequence)
    assert f"{DEPTH_INFO}: no message can be read" in caplog.text
    assert "depth is assumed to be registered" in caplog.text
    with pytest.raises(InputError, match=f"{DEPTH_INFO}: no message can be read"):
        BagRecording(bag, Topics(depth_info=DEPTH_INFO))


def test_ros_1_tells_the_place_on_tf(tmp_path: Path) -> None:
    places = [replace(place, topic="/tf") for place in PLACES]
    bag = write_rosbag2(tmp_path / "bag", [*places, *recorded("depth_optical")])
    with BagRecording(bag) as sequence:
        (frame,) = sequence
    np.testing.assert_allclose(frame.depth[10:-10, 10:-10], 1.5, rtol=1e-5)


def test_a_depth_camera_of_unknown_place_is_taken_to_be_at_that_of_colour_and_that_is_said(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    bag = write_rosbag2(tmp_path / "bag", recorded("depth_optical", NARROW_CAMERA))
    with caplog.at_level(logging.WARNING), BagRecording(bag) as sequence:
        (frame,) = sequence
    np.testing.assert_allclose(frame.depth[18:-18, 20:-20], 2.0, rtol=1e-5)
    assert np.isnan(frame.depth[:, 0]).all()  # which that camera does not see
    assert "--set depth_camera_pose=" in caplog.text


def test_the_depth_cameras_pose_is_taken_from_a_parameter(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    bag = write_rosbag2(tmp_path / "bag", recorded("depth_optical"))
    inputs = InputConfig(depth_camera_pose="0 0 -0.5 0 0 0")
    with caplog.at_level(logging.WARNING), BagRecording(bag, inputs=inputs) as sequence:
        (frame,) = sequence
    np.testing.assert_allclose(frame.depth[10:-10, 10:-10], 1.5, rtol=1e-5)
    assert not caplog.text


def without_info(depth_frame: str) -> list[Recorded]:
    return [message for message in recorded(depth_frame) if message.topic != DEPTH_INFO]


@pytest.mark.parametrize("depth_frame", ["color_optical", "depth_optical", ""])
def test_the_depth_camera_is_taken_from_a_calibration(depth_frame: str, tmp_path: Path) -> None:
    bag = write_rosbag2(tmp_path / "bag", without_info(depth_frame))
    inputs = InputConfig(depth_camera_pose="0 0 -0.5 0 0 0")
    with BagRecording(bag, inputs=inputs, depth_calibration=DEPTH_CAMERA) as sequence:
        (frame,) = sequence
    np.testing.assert_allclose(frame.depth[10:-10, 10:-10], 1.5, rtol=1e-5)


def test_the_depth_cameras_info_is_taken_from_any_topic(tmp_path: Path) -> None:
    *others, info = recorded("depth_optical")
    bag = write_rosbag2(tmp_path / "bag", [*PLACES, *others, replace(info, topic="/elsewhere")])
    with BagRecording(bag, Topics(depth_info="elsewhere")) as sequence:
        (frame,) = sequence
    np.testing.assert_allclose(frame.depth[10:-10, 10:-10], 1.5, rtol=1e-5)
    with pytest.raises(InputError, match=r"no topic /no of .*--depth-calibration FILE"):
        BagRecording(bag, Topics(depth_info="/no"))


def test_depth_in_the_frame_of_colour_by_another_camera_is_registered_and_that_is_said(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    bag = write_rosbag2(tmp_path / "bag", recorded("color_optical", NARROW_CAMERA))
    with caplog.at_level(logging.WARNING), BagRecording(bag) as sequence:
        (frame,) = sequence
    assert np.isnan(frame.depth[:, 0]).all()  # which that camera does not see
    assert "its camera is another one according to /camera/depth/camera_info" in caplog.text


def test_without_an_info_depth_in_another_frame_is_taken_as_registered_and_that_is_said(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    bag = write_rosbag2(tmp_path / "bag", without_info("depth_optical"))
    with caplog.at_level(logging.WARNING), BagRecording(bag) as sequence:
        (frame,) = sequence
    np.testing.assert_array_equal(frame.depth, 2.0)
    assert "--depth-calibration FILE" in caplog.text


def test_depth_that_is_registered_stays_as_it_is(tmp_path: Path) -> None:
    messages = recorded("color_optical")
    info = camera_info(CAMERA.scaled(80, 60), header(STAMP_NS, "color_optical"))
    bag = write_rosbag2(tmp_path / "bag", [*messages[:3], replace(messages[3], message=info)])
    with BagRecording(bag) as sequence:
        (frame,) = sequence
    np.testing.assert_array_equal(frame.depth, 2.0)


@pytest.mark.parametrize(
    ("told", "encoding", "is_said"),
    [
        (0.0002, "16UC1", True),
        (0.0002, "32FC1", False),  # floats are metres
        (0.001, "16UC1", False),
        (1.0, "16UC1", False),  # of floats
        (None, "16UC1", False),
    ],
)
def test_images_of_a_bag_have_the_units_of_ros_whatever_a_calibration_tells(
    told: float | None,
    encoding: str,
    is_said: bool,
    tmp_path: Path,
    caplog: pytest.LogCaptureFixture,
) -> None:
    color, depth, *infos = recorded("color_optical")
    if encoding == "16UC1":
        units = np.full((60, 80), 2000, np.uint16)
        image = replace(
            depth.message, encoding=encoding, step=160, data=units.view(np.uint8).ravel()
        )
        depth = replace(depth, message=image)
    bag = write_rosbag2(tmp_path / "bag", [color, depth, infos[0]])
    with open_recording(bag, calibration=Calibration(CAMERA, told)) as sequence:
        (frame,) = sequence
    assert frame.depth[24, 32] == pytest.approx(2.0)
    assert ("if that is right, give --depth-scale 0.0002" in caplog.text) is is_said
