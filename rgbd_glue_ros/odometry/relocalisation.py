"""Finds frames near keyframes without a prediction.

They are frames that tracking has lost, and those whose tracked poses go back to one that was not
measured, as at a bare wall or at a restart.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.geometry.gates import POSE_GATE, mahalanobis_squared
from rgbd_glue_ros.odometry.acceptance import Acceptance
from rgbd_glue_ros.odometry.keyframe import Keyframe
from rgbd_glue_ros.odometry.motion_filter import PredictedMotion
from rgbd_glue_ros.odometry.pose_covariance import PoseErrors, covariance_of, refined_covariance
from rgbd_glue_ros.odometry.pose_refinement import PoseEstimate, PoseProblem
from rgbd_glue_ros.odometry.tracking import Attempt, PoseFix
from rgbd_glue_ros.refinement.gauss_newton import Refinement, refine
from rgbd_glue_ros.registration.frame_features import FrameFeatures
from rgbd_glue_ros.registration.glue import Glue
from rgbd_glue_ros.types import Float64


@dataclass(frozen=True)
class Recognition:
    """A frame of one component of the map that shows a keyframe of another.

    Attributes:
        attempt: its pose by that keyframe.
        T_shift: float64 [4, 4], shifts its tracked pose to it, multiplied on the left.
        covariance: float64 [6, 6] of the pose of the newest keyframe of its component, after the
            shift and given the pose of the other keyframe; perturbation on the left.
    """

    attempt: Attempt
    T_shift: Float64
    covariance: Float64


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
        if not _may_be_registered(features, keyframe, glue, acceptance):
            continue
        registration = glue.register(features, keyframe.features)
        T_keyframe_camera = registration.T_target_source
        inliers = len(registration.visual_inliers)
        if T_keyframe_camera is None or inliers < acceptance.min_inliers:
            continue
        T_track_camera = keyframe.T_track_camera @ T_keyframe_camera
        refinement = refine(T_track_camera, replace(problem, model=keyframe.model))
        if _is_accepted(refinement, problem.predicted, acceptance):
            fix = PoseFix(PoseEstimate(refinement), reference=keyframe, model=keyframe.model)
            return Attempt(features, registration, fix)
    return None


def recognise(
    tracked: Attempt,
    fix: PoseFix,
    keyframe: Keyframe,
    problem: PoseProblem,
    glue: Glue,
    acceptance: Acceptance,
    errors: PoseErrors,
) -> Recognition | None:
    """The pose of a tracked frame by a keyframe of another component of the map.

    Args:
        tracked: the frame.
        fix: its pose as tracked.
        keyframe: of the other component.
        problem: the frame, its predicted motion, and how poses are refined.
        glue: registers the frame.
        acceptance: the evidence that a pose needs.
        errors: of the camera.

    Returns:
        None if the keyframe does not show the same place, or one that the camera cannot be at.
    """
    found = relocalise(tracked.features, [keyframe], problem, glue, acceptance)
    if found is None or found.fix is None:
        return None
    T_track_camera = fix.estimate.T_track_camera
    T_shift = found.fix.estimate.T_track_camera @ se3.inverse(T_track_camera)
    reach = se3.transported_covariance(T_track_camera, problem.predicted.reach_covariance())
    if not mahalanobis_squared(se3.log(T_shift), fix.reference.covariance + reach) <= POSE_GATE:
        return None
    seen, count = found.fix.estimate.refinement, errors.residuals_per_independent_one
    of_frame = refined_covariance(seen, keyframe.T_track_camera, problem.view.twist, errors)
    from_reference = covariance_of(fix.estimate.refinement.information, count)
    covariance = of_frame + se3.transported_covariance(T_shift, from_reference)
    joined = replace(found, fix=replace(found.fix, T_shift=T_shift))
    return Recognition(joined, T_shift, covariance)


def _may_be_registered(
    features: FrameFeatures, keyframe: Keyframe, glue: Glue, acceptance: Acceptance
) -> bool:
    """Whether a registration can have the visual inliers that it takes."""
    if glue.has_fallback:
        return True
    return len(glue.visual_inliers(features, keyframe.features)) >= acceptance.min_inliers


def _is_accepted(
    refinement: Refinement, predicted: PredictedMotion, acceptance: Acceptance
) -> bool:
    """Whether a pose is plausible, and within reach of the camera or conclusive."""
    return acceptance.is_plausible_place(refinement) and (
        predicted.reaches(refinement.T_model_source) or acceptance.allows_jump(refinement)
    )
