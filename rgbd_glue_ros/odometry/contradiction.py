"""Decides between two poses if a coherent part of the view contradicts the chosen one.

One of them may follow a person who walks by. The one with the larger surface wins: a person close
to the camera may fill the image, but the room has more square metres. As long as both are seen, the
covariance covers both poses.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.odometry.acceptance import Acceptance
from rgbd_glue_ros.odometry.alternative import (
    Alternative,
    agreeing_pixels,
    agreeing_planes,
    find_alternative,
    is_contradicted,
)
from rgbd_glue_ros.odometry.motion_filter import PredictedMotion
from rgbd_glue_ros.odometry.pose_choice import Candidate
from rgbd_glue_ros.odometry.pose_refinement import COARSE_LEVELS, PoseEstimate, PoseProblem
from rgbd_glue_ros.odometry.progress import LastPose
from rgbd_glue_ros.refinement.gauss_newton import Refinement, evaluate_pose
from rgbd_glue_ros.refinement.model import LEVELS
from rgbd_glue_ros.types import Float64


@dataclass(frozen=True)
class SettledPose:
    """The accepted pose, and its alternative.

    Attributes:
        estimate: the accepted pose.
        alternative: another pose on which a part of the frame agrees; None if nothing contradicts.
        T_shift: float64 [4, 4], to be multiplied on the left of tracked poses from this frame on,
            if those before turn out to be off by it: they followed a moving object, or go back to
            one that was not measured. None in all other frames.
    """

    estimate: PoseEstimate
    alternative: Alternative | None = None
    T_shift: Float64 | None = None


def settle_contradiction(
    chosen: Candidate, problem: PoseProblem, last: LastPose, acceptance: Acceptance
) -> SettledPose:
    """Returns the chosen pose and its alternative, swapped if there is more evidence for that.

    Swapping them takes the larger surface and a second piece of evidence: the previous frame, or
    the camera's motion.

    Args:
        chosen: the chosen pose.
        problem: the frame, and the inputs of its refinement.
        last: the last frame with a pose, and its alternative, if it had one.
        acceptance: the evidence that a pose needs.
    """
    pose = chosen.estimate
    # The coarse levels may see a contradiction that the finest one resolves; ask the finest first.
    if not is_contradicted(chosen.refinement):
        return SettledPose(pose)
    alternative = find_alternative(problem, chosen.coarse, last.alternative, acceptance)
    if alternative is None:
        return SettledPose(pose)
    distance_squared = problem.predicted.distance_squared(alternative.T_track_camera)
    is_likelier = distance_squared < chosen.distance_squared
    if alternative.is_larger and (last.alternative is not None or is_likelier):
        larger = _refined_alternative(problem, alternative, chosen.coarse, acceptance)
        if acceptance.is_plausible(larger.refinement):
            alternative = Alternative(pose.T_track_camera, 1 - alternative.share)
            pose = _counted_on_all_planes(problem, larger)
    T, T_shift = pose.T_track_camera, None
    if _goes_on_from_alternative(T, last, problem.predicted):
        # the pose before followed the same object as the alternative does
        T_shift = T @ se3.inverse(alternative.T_track_camera)
    return SettledPose(pose, alternative, T_shift)


def contradiction_covariance(
    pose: Refinement,
    alternative: Alternative | None,
    reach_covariance: Float64,
    acceptance: Acceptance,
) -> Float64:
    """What a contradiction adds to the covariance of a pose, float64 [6, 6].

    With an alternative, it is the second moment of the two poses about the accepted one, each
    weighted by its share. If planes contradict the pose without agreeing on another, so that only
    pixels support it, the fraction of ``reach_covariance`` is added that does not agree.

    Args:
        pose: the accepted pose.
        alternative: its alternative; None if there is none.
        reach_covariance: float64 [6, 6] of where the camera can be, perturbation on the right.
        acceptance: how many planes count as a contradiction.

    Returns:
        The covariance, perturbation on the left, in the track frame.
    """
    T = pose.T_model_source
    if alternative is not None:
        apart = se3.log(alternative.T_track_camera @ se3.inverse(T))
        return np.asarray(alternative.share * np.outer(apart, apart), np.float64)
    agreeing = pose.visible_agreement
    if pose.planes_visible < acceptance.min_planes or agreeing >= acceptance.plane_agreement:
        return np.zeros((6, 6))
    return np.asarray((1 - agreeing) * se3.transported_covariance(T, reach_covariance), np.float64)


def _refined_alternative(
    problem: PoseProblem, alternative: Alternative, pose: Refinement, acceptance: Acceptance
) -> PoseEstimate:
    """The alternative, refined without planes and pixels that agree only with the other pose.

    If the two poses are near each other, these would pull it back.

    Args:
        problem: the frame, and the inputs of its refinement.
        alternative: the alternative to ``pose``.
        pose: the pose that was accepted before.
        acceptance: when a pose is plausible.
    """
    own, other, brightness = alternative.T_track_camera, pose.T_model_source, pose.affine_brightness
    levels = [problem.at_level(level) for level in range(LEVELS)]
    planes = agreeing_planes(levels[0], own) | ~agreeing_planes(levels[0], other)
    pixels = [
        agreeing_pixels(level, own, brightness) | ~agreeing_pixels(level, other, brightness)
        for level in levels
    ]
    of_the_rest = replace(problem, model=problem.model.selected(planes, pixels))
    coarse = of_the_rest.refined(own, COARSE_LEVELS, brightness)
    return of_the_rest.refined_further(coarse, acceptance)


def _counted_on_all_planes(problem: PoseProblem, estimate: PoseEstimate) -> PoseEstimate:
    """A pose that was refined on a part of the model, with the numbers of all planes.

    Otherwise the other part of the frame would seem to show what no keyframe does.
    """
    by_all = evaluate_pose(estimate.T_track_camera, problem.with_twist_used_for(estimate))
    refinement = replace(
        estimate.refinement,
        planes_seen=by_all.planes_seen,
        planes_agreeing=by_all.planes_agreeing,
        planes_occluded=by_all.planes_occluded,
    )
    return replace(estimate, refinement=refinement)


def _goes_on_from_alternative(
    T_track_camera: Float64, last: LastPose, predicted: PredictedMotion
) -> bool:
    """Whether a pose continues the last alternative instead of the last pose.

    In that case tracking had followed a moving object.
    """
    if last.alternative is None or predicted.expects(T_track_camera):
        return False
    T_shift = last.alternative.T_track_camera @ se3.inverse(last.motion.T_track_camera)
    return predicted.shifted(T_shift).expects(T_track_camera)
