"""Edges between keyframes as messages, as the node publishes them."""

from __future__ import annotations

from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.live import topics
from rgbd_glue_ros.messages import fields
from rgbd_glue_ros.types import PoseGraphEdge


def edge_message(edge: PoseGraphEdge, stamp_ns: int) -> fields.Odometry:
    """The pose of a keyframe in another one, with its covariance; the twist is unknown.

    Args:
        edge: the edge between the published frames of the two keyframes.
        stamp_ns: stamp of the child, nanoseconds.
    """
    T = edge.T_parent_child
    head = fields.header(stamp_ns, topics.KEYFRAME_FRAME.format(edge.parent))
    pose = fields.pose_stamped(T, head).pose
    covariance = se3.pose_covariance(T, edge.covariance).ravel()
    return fields.Odometry(
        head,
        topics.KEYFRAME_FRAME.format(edge.child),
        fields.PoseWithCovariance(pose, covariance),
    )
