"""What tracking measures between keyframes: the edges of a pose graph.

An edge is between poses as tracked, without drift correction: what an anchor indicates is a
separate edge, and no edge contains another. Still, a frame is refined on the models of a few
keyframes at once, and only the nearest is the parent, so that errors of neighbouring edges are
somewhat correlated.
"""

from __future__ import annotations

import numpy as np

from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.odometry.keyframes import Keyframe, RecentKeyframe
from rgbd_glue_ros.odometry.motion_filter import Motion
from rgbd_glue_ros.parameters import Config, OdometryConfig
from rgbd_glue_ros.refinement.gauss_newton import Refinement
from rgbd_glue_ros.types import EdgeOrigin, Float64, PoseGraphEdge


def edge_from(
    parent: Keyframe,
    child: int,
    T_track_camera: Float64,
    covariance: Float64,
    origin: EdgeOrigin = EdgeOrigin.TRACKING,
) -> PoseGraphEdge:
    """The edge to a frame whose pose and whose parent's pose are known.

    Args:
        parent: keyframe that the pose was found from.
        child: number of the frame's keyframe.
        T_track_camera: pose of the frame, in the frame of the parent's pose, float64 [4, 4].
        covariance: float64 [6, 6] of the frame's pose given the parent's; perturbation on the
            left, in the same frame.
        origin: what measured it.
    """
    T_parent_track = se3.inverse(parent.T_track_camera)
    T_parent_child = T_parent_track @ T_track_camera
    in_parent = se3.transported_covariance(T_parent_track, covariance)
    return PoseGraphEdge(parent.number, child, T_parent_child, in_parent, origin)


def revisit_edge(
    anchor: Keyframe, keyframe: RecentKeyframe, refinement: Refinement, config: Config
) -> PoseGraphEdge:
    """The edge from an anchor to a keyframe that was refined on the anchor's model."""
    twist = keyframe.features.view.twist
    covariance = refined_covariance(refinement, anchor.T_track_camera, twist, config)
    T = refinement.T_model_source
    return edge_from(anchor, keyframe.number, T, covariance, EdgeOrigin.REVISIT)


def refined_covariance(
    refinement: Refinement, T_model_anchor: Float64, twist: Float64, config: Config
) -> Float64:
    """Covariance [6, 6] of a refined pose, perturbation on the left, in the model's frame.

    Args:
        refinement: the pose.
        T_model_anchor: pose of the camera that the model is of, float64 [4, 4].
        twist: velocity [6] of the camera whose pose it is.
        config: how the residuals are correlated, and what they do not show.
    """
    T = refinement.T_model_source
    seen = np.linalg.inv(refinement.information / config.refine.residuals_per_independent_one)
    distance = float(np.linalg.norm(T[:3, 3] - T_model_anchor[:3, 3]))
    unseen = unseen_covariance(twist, distance, config.odometry)
    return seen + se3.transported_covariance(T, unseen)


def tracked_covariance(motion: Motion, reference: Keyframe, config: OdometryConfig) -> Float64:
    """Covariance [6, 6] of a tracked pose, perturbation on the left, track frame.

    The sum of that of its keyframe, that of the motion, and what no residual shows.

    Args:
        motion: with the pose.
        reference: keyframe that the pose was found from.
        config: sizes of errors of time and scale.
    """
    T = motion.T_track_camera
    distance = float(np.linalg.norm(T[:3, 3] - reference.T_track_camera[:3, 3]))
    unseen = unseen_covariance(motion.twist, distance, config)
    from_keyframe = motion.covariance[:6, :6] + unseen
    return reference.covariance + se3.transported_covariance(T, from_keyframe)


def timing_covariance(motion: Motion, config: OdometryConfig) -> Float64:
    """The part of ``tracked_covariance`` due to the time of this image alone, float64 [6, 6].

    Args:
        motion: with the pose.
        config: size of errors of time.
    """
    late = _late_covariance(motion.twist, config)
    return se3.transported_covariance(motion.T_track_camera, late)


def unseen_covariance(twist: Float64, distance: float, config: OdometryConfig) -> Float64:
    """The part of a relative pose's covariance that no residual shows: errors of time and scale.

    Args:
        twist: velocity [6] of the camera.
        distance: from the keyframe, metres.
        config: sizes of these errors.

    Returns:
        float64 [6, 6], in the camera's frame.
    """
    scale = np.diag([(config.scale_error * distance) ** 2] * 3 + [0.0] * 3)
    return np.asarray(_late_covariance(twist, config) + scale, np.float64)


def _late_covariance(twist: Float64, config: OdometryConfig) -> Float64:
    """Covariance of an error in the time of an image, float64 [6, 6], in the camera's frame."""
    late = config.timing_error * np.linalg.norm(twist.reshape(2, 3), axis=1)
    return np.diag([late[0] ** 2] * 3 + [late[1] ** 2] * 3)
