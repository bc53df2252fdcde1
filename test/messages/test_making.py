"""Messages without ROS are those of rclpy."""

from __future__ import annotations

import numpy as np
import pytest
from rigs.messages import CAMERA, DEPTH, HEAD, RGB

from rgbd_glue_ros.messages import making
from rgbd_glue_ros.messages.camera_info import intrinsics_from_message
from rgbd_glue_ros.messages.images import color_from_message, depth_from_message
from rgbd_glue_ros.messages.making import (
    camera_info,
    color_image,
    compressed_depth_image,
    millimetre_image,
)
from rgbd_glue_ros.messages.reading import stamp_ns


def test_rclpy_messages_are_filled_and_read_like_plain_ones() -> None:
    ros = pytest.importorskip("sensor_msgs.msg", reason="needs the ROS message packages")
    filled = making.copy_fields(color_image(RGB, HEAD), ros.Image())
    assert np.array_equal(color_from_message(filled, "/color"), RGB)
    depth = making.copy_fields(compressed_depth_image(DEPTH, HEAD), ros.CompressedImage())
    assert depth_from_message(depth, "/depth") == pytest.approx(DEPTH, abs=0.0006)
    info = making.copy_fields(camera_info(CAMERA, HEAD), ros.CameraInfo())
    assert intrinsics_from_message(info, "/info") == CAMERA
    assert stamp_ns(info.header.stamp) == stamp_ns(HEAD.stamp)


def test_whole_millimetres_survive_a_round_trip_and_depth_that_is_too_far_becomes_unknown() -> None:
    depth = np.array([[0.001, 1.2344, 65.534], [65.535, 70.0, np.nan]], np.float32)
    image = millimetre_image(depth, HEAD)
    assert (image.encoding, image.step, len(image.data)) == ("16UC1", 6, 12)
    expected = np.array([[0.001, 1.234, 65.534], [np.nan] * 3], np.float32)
    np.testing.assert_array_equal(depth_from_message(image, "/depth"), expected)
