"""The mapping node over real DDS: drift comes in, map -> odom and a corrected path come out."""

from __future__ import annotations

import sys
from functools import partial

import numpy as np
import pytest
from rigs.bag_frames import recorded_frames
from rigs.drifted import CHANGED, drifted, rmse

from rgbd_glue_ros.experiments.demo.node_process import NodeProcess, ros_environment
from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.live.topics import (
    KEYFRAME_EDGES,
    KEYFRAME_FRAME,
    KEYFRAME_POSE,
    MAP_FRAME,
    MAP_PATH,
    POSE,
)
from rgbd_glue_ros.messages import fields
from rgbd_glue_ros.messages.fields import copy_fields
from rgbd_glue_ros.messages.poses import pose_from_message
from rgbd_glue_ros.messages.reading import stamp_ns
from rgbd_glue_ros.types import Float64, PoseGraphEdge

pytest.importorskip("rclpy", reason="ROS is not installed")
pytest.importorskip("tf2_msgs", reason="tf2_msgs is not installed (scripts/tf2-msgs builds it)")
pytest.importorskip("gtsam", reason="GTSAM is not installed")
pytest.importorskip("pyhbst", reason="pyHBST is not installed")

from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Odometry as OdometryMessage
from nav_msgs.msg import Path
from rclpy.qos import ReliabilityPolicy
from rigs.ros import START_S
from rigs.tf import Robot

MODULE = "rgbd_glue_ros.node.mapping"
MAPPED_S = 60.0


def pose_message(T: Float64, at_ns: int) -> PoseStamped:
    return copy_fields(fields.pose_stamped(T, fields.header(at_ns, "odom")), PoseStamped())


def edge_message(edge: PoseGraphEdge, at_ns: int) -> OdometryMessage:
    message = OdometryMessage(child_frame_id=KEYFRAME_FRAME.format(edge.child))
    head = fields.header(at_ns, KEYFRAME_FRAME.format(edge.parent))
    stamped = copy_fields(fields.pose_stamped(edge.T_parent_child, head), PoseStamped())
    message.header, message.pose.pose = stamped.header, stamped.pose
    covariance = se3.pose_covariance(edge.T_parent_child, edge.covariance)
    message.pose.covariance = covariance.ravel()
    return message


def test_drift_is_taken_out_of_the_map_and_odom_is_left_as_it_is(ros_domain: int) -> None:
    keyframes = drifted()
    frames = recorded_frames()
    with (
        NodeProcess(CHANGED, ros_environment(ros_domain), module=MODULE) as node,
        Robot(ros_domain) as robot,
    ):
        paths: list[Path] = []
        robot.node.create_subscription(Path, MAP_PATH, paths.append, 10)
        poses = robot.publisher(PoseStamped, KEYFRAME_POSE)
        edges = robot.publisher(OdometryMessage, KEYFRAME_EDGES)
        tracked = robot.publisher(PoseStamped, POSE)
        node.wait_for_line("Subscribed", START_S)
        publishers = (robot.color, robot.depth, robot.info, poses, edges, tracked)

        def is_matched() -> bool:
            for images in publishers[:3]:
                listeners = robot.node.get_subscriptions_info_by_topic(images.topic_name)
                if {i.qos_profile.reliability for i in listeners} != {ReliabilityPolicy.RELIABLE}:
                    return False
            taken = [p.get_subscription_count() for p in publishers]
            return min(taken) > 0 and bool(robot.node.count_publishers(MAP_PATH))

        def has_path_of(count: int) -> bool:
            return bool(paths) and len(paths[-1].poses) == count

        robot.wait(is_matched, "the node's subscriptions", START_S)
        for number, keyframe in enumerate(keyframes):
            frame = frames[keyframe.row]
            # keyframes are known by their edges, and come before their images as well as after
            poses.publish(pose_message(keyframe.T_odom_camera, frame.stamp_ns))
            for edge in keyframe.edges:
                edges.publish(edge_message(edge, frame.stamp_ns))
            robot.publish(frame)
            if number:
                robot.wait(
                    partial(has_path_of, number + 1), f"the path with keyframe {number}", MAPPED_S
                )
        last = keyframes[-1]
        at_ns = frames[last.row].stamp_ns
        tracked.publish(pose_message(last.T_odom_camera, at_ns))
        robot.wait(lambda: robot.heard, "map -> odom")
        sys.stdout.write("\n".join(node.lines))

    path = paths[-1]
    assert path.header.frame_id == MAP_FRAME
    assert [stamp_ns(p.header.stamp) for p in path.poses] == [
        frames[keyframe.row].stamp_ns for keyframe in keyframes
    ]
    truth = np.array([keyframe.T_true for keyframe in keyframes])
    before = rmse(np.array([keyframe.T_odom_camera for keyframe in keyframes]), truth)
    found = np.array([pose_from_message(p, MAP_PATH) for p in path.poses])
    assert rmse(found, truth) < 0.25 * before
    heard = robot.heard[-1]
    assert (heard.header.frame_id, heard.child_frame_id) == (MAP_FRAME, "odom")
    assert stamp_ns(heard.header.stamp) == at_ns
    T_map_odom = pose_from_message(heard, "/tf")
    assert se3.difference(T_map_odom, np.eye(4)) > 0.02
    np.testing.assert_allclose(T_map_odom @ last.T_odom_camera, found[-1], atol=1e-6)
