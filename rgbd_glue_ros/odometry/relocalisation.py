"""Searches for a frame that tracking lost near any of the keyframes, without a prediction."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from rgbd_glue_ros.odometry.acceptance import Acceptance
from rgbd_glue_ros.odometry.keyframes import Keyframe
from rgbd_glue_ros.odometry.motion_filter import PredictedMotion
from rgbd_glue_ros.odometry.pose_refinement import PoseEstimate, PoseProblem
from rgbd_glue_ros.odometry.tracking import Attempt, PoseFix
from rgbd_glue_ros.refinement.gauss_newton import Refinement, refine
from rgbd_glue_ros.registration.frame_features import FrameFeatures
from rgbd_glue_ros.registration.glue import Glue


def relocalise(
    features: FrameFeatures,
    keyframes: Iterable[Keyframe],
    problem: PoseProblem,
    glue: Glue,
    acceptance: Acceptance,
) -> Attempt | None:
    """The pose of a frame by the first keyframe that gives an acceptable one.

    Args:
        features: of the frame.
        keyframes: to try, in this order.
        problem: the frame, its predicted motion, and how poses are refined.
        glue: registers the frame.
        acceptance: the evidence that a pose needs.

    Returns:
        None if no keyframe gives one.
    """
    for keyframe in keyframes:
        registration = glue.register(features, keyframe.features)
        T_keyframe_camera = registration.T_target_source
        inliers = len(registration.visual_inliers)
        if T_keyframe_camera is None or inliers < acceptance.min_inliers:
            continue
        T_track_camera = keyframe.T_track_camera @ T_keyframe_camera
        refinement = refine(T_track_camera, replace(problem, model=keyframe.model))
        if _is_accepted(refinement, problem.predicted, acceptance):
            fix = PoseFix(PoseEstimate(refinement), keyframe, keyframe.model)
            return Attempt(features, registration, fix)
    return None


def _is_accepted(
    refinement: Refinement, predicted: PredictedMotion, acceptance: Acceptance
) -> bool:
    """Whether a pose is plausible, and within reach of the camera or conclusive."""
    return acceptance.is_plausible_place(refinement) and (
        predicted.reaches(refinement.T_model_source) or acceptance.allows_jump(refinement)
    )
