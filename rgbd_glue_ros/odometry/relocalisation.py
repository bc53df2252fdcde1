"""Searches for a frame that tracking lost near any of the keyframes, without a prediction."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from rgbd_glue_ros.odometry.acceptance import is_conclusive, is_plausible
from rgbd_glue_ros.odometry.keyframes import Keyframe
from rgbd_glue_ros.odometry.motion_filter import PredictedMotion
from rgbd_glue_ros.odometry.pose_refinement import PoseEstimate, PoseProblem
from rgbd_glue_ros.odometry.tracking import Attempt, PoseFix
from rgbd_glue_ros.parameters import OdometryConfig
from rgbd_glue_ros.refinement.gauss_newton import Refinement, refine
from rgbd_glue_ros.registration.frame_features import FrameFeatures
from rgbd_glue_ros.registration.glue import Glue


def relocalise(
    features: FrameFeatures,
    keyframes: Iterable[Keyframe],
    problem: PoseProblem,
    glue: Glue,
    config: OdometryConfig,
    *,
    is_lost: bool,
) -> Attempt | None:
    """The pose of a frame by the first keyframe that gives an acceptable one.

    Args:
        features: of the frame.
        keyframes: to try, in this order.
        problem: the frame, its predicted motion, and how poses are refined.
        glue: registers the frame.
        config: when a pose is accepted: on more evidence than tracking requires.
        is_lost: whether the previous frame had no pose. Poses of consecutive frames are never
            farther apart than a camera can move: a jump is announced by a frame without a pose.

    Returns:
        None if no keyframe gives one.
    """
    for keyframe in keyframes:
        registration = glue.register(features, keyframe.features)
        T_keyframe_camera = registration.T_target_source
        inliers = len(registration.visual_inliers)
        if T_keyframe_camera is None or inliers < config.relocalisation_inliers:
            continue
        T_track_camera = keyframe.T_track_camera @ T_keyframe_camera
        refinement = refine(T_track_camera, replace(problem, model=keyframe.model))
        if _is_believed(refinement, problem.predicted, config, is_lost=is_lost):
            fix = PoseFix(PoseEstimate(refinement), keyframe, keyframe.model)
            return Attempt(features, registration, fix)
    return None


def _is_believed(
    refinement: Refinement,
    predicted: PredictedMotion,
    config: OdometryConfig,
    *,
    is_lost: bool,
) -> bool:
    """Whether planes and pixels both support a pose.

    Occluded planes count too: a person in front of the camera is not evidence for a place.
    """
    return (
        is_plausible(refinement, refinement.planes_seen, config)
        and refinement.brightness_correlation >= config.brightness_correlation
        and (
            predicted.reaches(refinement.T_model_source)
            or (is_lost and is_conclusive(refinement, config))
        )
    )
