"""Depth of another camera, through the node over real DDS."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.live.topics import DEPTH_INFO
from rgbd_glue_ros.messages.making import camera_info, color_image, copy_fields, depth_image, header
from rgbd_glue_ros.messages.poses import pose_from_message
from rgbd_glue_ros.types import NANOSECONDS, CameraIntrinsics, Float32

pytest.importorskip("rclpy", reason="ROS is not installed")

from rclpy.publisher import Publisher
from rigs.faults import running_node
from rigs.ros import OPTICAL_FRAME, PATIENCE_S, START_NS, Rig, corner_frame
from sensor_msgs.msg import CameraInfo, Image

PERIOD_NS = NANOSECONDS // 30
DEPTH_CAMERA = CameraIntrinsics(424, 240, 212.0, 212.0, 211.5, 119.5)
DEPTH_FRAME = "camera_depth_optical_frame"
PLACE = np.array([0.05, 0.0, -0.2])  # of the depth camera in the colour camera, metres


def corner_depth() -> Float32:
    """The corner of ``corner_frame`` as the depth camera sees it, as planes n · p = d."""
    v, u = np.mgrid[: DEPTH_CAMERA.height, : DEPTH_CAMERA.width]
    K = DEPTH_CAMERA
    rays = np.stack([(u - K.cx) / K.fx, (v - K.cy) / K.fy, np.ones(u.shape)], axis=-1)
    distances = []
    for normal, d in (((1, 0, 1), 3), ((-1, 0, 1), 3), ((0, 1, 0.5), 1.5)):
        along = rays @ np.array(normal, float)
        with np.errstate(divide="ignore"):
            distances.append(np.where(along > 0, (d - PLACE @ normal) / along, np.inf))
    return np.asarray(np.min(distances, axis=0), np.float32)


def publish(rig: Rig, stamp_ns: int, info: Publisher | None = None) -> None:
    frame = corner_frame(stamp_ns)
    head, depth_head = header(stamp_ns, frame.frame_id), header(stamp_ns, DEPTH_FRAME)
    rig.color.publish(copy_fields(color_image(frame.color, head), Image()))
    rig.depth.publish(copy_fields(depth_image(corner_depth(), depth_head), Image()))
    rig.info.publish(copy_fields(camera_info(frame.intrinsics, head), CameraInfo()))
    if info is not None:
        info.publish(copy_fields(camera_info(DEPTH_CAMERA, depth_head), CameraInfo()))


@pytest.mark.slow
def test_unregistered_depth_is_refused_with_what_to_enable_in_the_driver(
    ros_domain: int,
) -> None:
    with running_node(ros_domain) as node, Rig(ros_domain) as rig:
        rig.wait_until_matched()
        publish(rig, START_NS)
        line = node.wait_for_line("is not registered to colour", PATIENCE_S)
        assert "align_depth.enable" in line
        assert DEPTH_INFO in line
        assert not rig.poses


@pytest.mark.slow
@pytest.mark.every_python
def test_unregistered_depth_is_registered_if_its_camera_and_pose_are_known(
    ros_domain: int,
) -> None:
    x, y, z = PLACE
    given = {
        "depth_camera_pose": f"'{x} {y} {z} 0 0 0'",
        "depth_info_topic": "/elsewhere/camera_info",
        "camera_axes": "optical",
    }
    with running_node(ros_domain, **given) as node, Rig(ros_domain) as rig:
        info = rig.publisher(CameraInfo, "/elsewhere/camera_info")
        rig.wait_until_matched()
        rig.wait(info.get_subscription_count, "the subscription to the depth camera's info")
        publish(rig, START_NS)
        node.wait_for_line("/elsewhere/camera_info: no camera info was received", PATIENCE_S)
        stamps = itertools.count(START_NS + PERIOD_NS, PERIOD_NS)

        def has_pose() -> bool:
            publish(rig, next(stamps), info)
            rig.spin_for(0.2)
            return bool(rig.poses)

        rig.wait(has_pose, "a pose")
        # the next comes registered, from where the camera was: it fits only what is in its place

        pose = rig.pose_of(corner_frame(next(stamps)))
        np.testing.assert_allclose(pose_from_message(pose, "pose"), np.eye(4), atol=2e-3)


@pytest.mark.slow
def test_the_pose_of_the_depth_camera_may_come_from_tf(ros_domain: int) -> None:
    pytest.importorskip("tf2_msgs", reason="tf2_msgs is not installed (scripts/tf2-msgs builds it)")
    from rigs.tf import Robot, transform

    with Robot(ros_domain) as rig:
        T = se3.from_rotation_translation(np.eye(3), PLACE)
        rig.tell(transform(OPTICAL_FRAME, DEPTH_FRAME, T))
        with running_node(ros_domain, camera_axes="optical", wait_for_transform=5):
            info = rig.publisher(CameraInfo, DEPTH_INFO)
            rig.wait_until_matched()
            rig.wait(info.get_subscription_count, "the subscription to the depth camera's info")
            publish(rig, START_NS, info)
            rig.pose_at(START_NS)
            pose = rig.pose_of(corner_frame(START_NS + PERIOD_NS))
            np.testing.assert_allclose(pose_from_message(pose, "pose"), np.eye(4), atol=2e-3)


@pytest.mark.slow
def test_depth_that_is_registered_despite_its_frame_is_used_unchanged(
    ros_domain: int,
) -> None:
    with running_node(ros_domain, depth_is_registered=True), Rig(ros_domain) as rig:
        rig.wait_until_matched()
        frame = corner_frame(START_NS)
        head, depth_head = (header(START_NS, name) for name in (frame.frame_id, DEPTH_FRAME))
        rig.color.publish(copy_fields(color_image(frame.color, head), Image()))
        rig.depth.publish(copy_fields(depth_image(frame.depth, depth_head), Image()))
        rig.info.publish(copy_fields(camera_info(frame.intrinsics, head), CameraInfo()))
        rig.pose_at(START_NS)


@pytest.mark.slow
def test_the_pose_of_the_depth_camera_may_come_on_tf_and_not_only_on_tf_static(
    ros_domain: int,
) -> None:
    pytest.importorskip("tf2_msgs", reason="tf2_msgs is not installed (scripts/tf2-msgs builds it)")
    from rigs.tf import Robot, transform
    from tf2_msgs.msg import TFMessage

    with running_node(ros_domain, wait_for_transform=5), Robot(ros_domain) as rig:
        info = rig.publisher(CameraInfo, DEPTH_INFO)
        rig.wait_until_matched()
        rig.wait(info.get_subscription_count, "the subscription to the depth camera's info")
        T = se3.from_rotation_translation(np.eye(3), PLACE)
        stamps = itertools.count(START_NS, PERIOD_NS)

        def has_pose() -> bool:
            at_ns = next(stamps)
            moving = transform(OPTICAL_FRAME, DEPTH_FRAME, T, at_ns)
            rig.moving.publish(TFMessage(transforms=[moving]))
            publish(rig, at_ns, info)
            rig.spin_for(0.1)
            return bool(rig.poses)

        rig.wait(has_pose, "a pose")


@pytest.mark.slow
def test_frames_that_wait_for_the_pose_of_the_depth_camera_are_not_called_slow(
    ros_domain: int,
) -> None:
    pytest.importorskip("tf2_msgs", reason="tf2_msgs is not installed (scripts/tf2-msgs builds it)")
    with running_node(ros_domain) as node, Rig(ros_domain) as rig:
        info = rig.publisher(CameraInfo, DEPTH_INFO)
        rig.wait_until_matched()
        rig.wait(info.get_subscription_count, "the subscription to the depth camera's info")
        stamps = itertools.count(START_NS, PERIOD_NS)

        def is_told() -> bool:
            publish(rig, next(stamps), info)
            rig.spin_for(PERIOD_NS / NANOSECONDS)
            return any("frames were dropped" in line for line in node.lines)

        rig.wait(is_told, "the diagnosis")
        line = node.wait_for_line("frames were dropped", PATIENCE_S)
        transform = f"the transform from {DEPTH_FRAME} to {OPTICAL_FRAME}"
        assert f"for {transform} on TF: make sure that it is broadcast" in line
        assert not [line for line in node.lines if "processor time" in line]
        assert any(f"the pose of {DEPTH_FRAME} in {OPTICAL_FRAME}" in line for line in node.lines)
