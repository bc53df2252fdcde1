"""Edges of the pose graph as messages, as the node publishes and the mapping node reads them."""

from __future__ import annotations

from typing import Any

import numpy as np

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.live import topics
from rgbd_glue_ros.live.extrinsics import Extrinsics
from rgbd_glue_ros.messages import fields, making
from rgbd_glue_ros.messages.poses import pose_from_message
from rgbd_glue_ros.types import Float64, OdometryEstimate, PoseGraphEdge

FIRST = topics.KEYFRAME_FRAME.format(0)
"""The frame of the first keyframe of a graph."""


def start_message(
    T_odom_child: Float64, covariance: Float64, stamp_ns: int, odom_frame_id: str
) -> fields.Odometry:
    """The pose of a graph's first keyframe in odom: it says that a graph begins, and where.

    Args:
        T_odom_child: float64 [4, 4].
        covariance: of that pose, float64 [6, 6], as in nav_msgs.
        stamp_ns: of the keyframe, nanoseconds.
        odom_frame_id: the fixed frame; the parent of all other edges is a keyframe.
    """
    head = making.header(stamp_ns, odom_frame_id)
    pose = making.pose_stamped(T_odom_child, head).pose
    return fields.Odometry(head, FIRST, fields.PoseWithCovariance(pose, covariance.ravel()))


def graph_start(
    estimate: OdometryEstimate, extrinsics: Extrinsics, odom_frame_id: str
) -> fields.Odometry | None:
    """``start_message`` of the first keyframe of a graph; None if it has no pose.

    Args:
        estimate: of that keyframe.
        extrinsics: between the camera and the published frames.
        odom_frame_id: the fixed frame.
    """
    if estimate.T_odom_camera is None or estimate.covariance is None:
        return None
    T = extrinsics.pose(estimate.T_odom_camera)
    covariance = extrinsics.pose_covariance(estimate.T_odom_camera, estimate.covariance)
    return start_message(T, covariance, estimate.stamp_ns, odom_frame_id)


def begins_graph(message: Any) -> bool:
    """Whether a message is one of ``start_message``."""
    return message.child_frame_id == FIRST and not topics.is_keyframe(message.header.frame_id)


def edge_message(edge: PoseGraphEdge, stamp_ns: int) -> fields.Odometry:
    """The pose of a keyframe in another one, with its covariance; the twist is unknown.

    Args:
        edge: the edge between the published frames of the two keyframes.
        stamp_ns: stamp of the child, nanoseconds.
    """
    T = edge.T_parent_child
    head = making.header(stamp_ns, topics.KEYFRAME_FRAME.format(edge.parent))
    pose = making.pose_stamped(T, head).pose
    covariance = se3.pose_covariance(T, edge.covariance).ravel()
    return fields.Odometry(
        head,
        topics.KEYFRAME_FRAME.format(edge.child),
        fields.PoseWithCovariance(pose, covariance),
    )


def edge_from_message(message: Any) -> PoseGraphEdge:
    """The edge of a message of ``edge_message``, which may also be rclpy's nav_msgs/Odometry.

    Raises:
        InputError: the pose or the covariance is invalid, or a frame is not named as a keyframe.
    """
    T = pose_from_message(message, topics.KEYFRAME_EDGES)
    parent, child = (
        topics.keyframe_number(name) for name in (message.header.frame_id, message.child_frame_id)
    )
    covariance = np.asarray(message.pose.covariance, np.float64).reshape(6, 6)
    if not (np.isfinite(covariance).all() and np.linalg.eigvalsh(covariance).min() > 0):
        raise InputError(
            topics.KEYFRAME_EDGES,
            "a covariance is not positive definite",
            "subscribe to the edges of the odometry node",
        )
    return PoseGraphEdge(parent, child, T, se3.perturbation_covariance(T, covariance))
