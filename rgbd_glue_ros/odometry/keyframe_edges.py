"""What tracking measures between keyframes: the edges of a pose graph.

An edge is between poses as tracked, without drift correction: what an anchor indicates is a
separate edge, and no edge contains another. Still, a frame is refined on the models of a few
keyframes at once, and only the nearest is the parent, so that errors of neighbouring edges are
somewhat correlated.
"""

from __future__ import annotations

from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.odometry.keyframe import Keyframe, NewestKeyframe
from rgbd_glue_ros.odometry.pose_covariance import PoseErrors, refined_covariance, tilt_covariance
from rgbd_glue_ros.refinement.gauss_newton import Refinement
from rgbd_glue_ros.types import EdgeOrigin, Float64, PoseGraphEdge


def edge_from(
    parent: Keyframe,
    child_number: int,
    T_track_camera: Float64,
    covariance: Float64,
    origin: EdgeOrigin = EdgeOrigin.TRACKING,
) -> PoseGraphEdge:
    """The edge to a frame whose pose and whose parent's pose are known.

    Args:
        parent: keyframe that the pose was found from.
        child_number: of the keyframe that the frame becomes.
        T_track_camera: pose of the frame, in the frame of the parent's pose, float64 [4, 4].
        covariance: float64 [6, 6] of the frame's pose given the parent's; perturbation on the
            left, in the same frame.
        origin: what measured it.
    """
    T_parent_track = se3.inverse(parent.T_track_camera)
    T_parent_child = T_parent_track @ T_track_camera
    in_parent = se3.transported_covariance(T_parent_track, covariance)
    in_child = se3.transported_covariance(se3.inverse(T_parent_child), in_parent)
    tilt = se3.transported_covariance(T_parent_child, tilt_covariance(in_child))
    return PoseGraphEdge(parent.number, child_number, T_parent_child, in_parent + tilt, origin)


def revisit_edge(
    anchor: Keyframe, keyframe: NewestKeyframe, refinement: Refinement, errors: PoseErrors
) -> PoseGraphEdge:
    """The edge from an anchor to a keyframe that was refined on the anchor's model."""
    twist = keyframe.features.view.twist
    covariance = refined_covariance(refinement, anchor.T_track_camera, twist, errors)
    T = refinement.T_model_source
    return edge_from(anchor, keyframe.number, T, covariance, EdgeOrigin.REVISIT)
