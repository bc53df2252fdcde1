"""Which of two poses to believe, where a coherent part of the view contradicts the one chosen.

One of them may be of somebody who walks by. The larger surface is believed: a person fills an image
from near by, but the room has more square metres. As long as both are seen, the pose is no more
certain than that.
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
from rgbd_glue_ros.refinement.gauss_newton import Refinement
from rgbd_glue_ros.refinement.model import LEVELS
from rgbd_glue_ros.types import Float64


@dataclass(frozen=True)
class SettledPose:
    """The pose that is believed, and what else the frame may show.

    Attributes:
        estimate: the pose.
        alternative: what a part of the frame agrees on instead; None where nothing contradicts.
        T_shift: float64 [4, 4], multiplied on the left of poses as tracked from this frame on,
            where those before turned out to be carried along; None in all other frames.
    """

    estimate: PoseEstimate
    alternative: Alternative | None = None
    T_shift: Float64 | None = None


def settle_contradiction(
    chosen: Candidate, problem: PoseProblem, last: LastPose, acceptance: Acceptance
) -> SettledPose:
    """The chosen pose and what contradicts it; the other way round where more speaks for that.

    That takes the larger surface and one more witness: the frame before, or the camera's motion.

    Args:
        chosen: the pose.
        problem: the frame, and what its pose was refined by.
        last: the last frame with a pose; its alternative, if that was contradicted too.
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
    has_witness = last.alternative is not None or is_likelier
    if alternative.is_larger and has_witness:
        larger = preferred(problem, alternative, chosen.coarse, acceptance)
        if acceptance.is_plausible(larger.refinement, larger.refinement.planes_visible):
            alternative = Alternative(pose.T_track_camera, 1 - alternative.share)
            pose = larger
    T, T_other = pose.T_track_camera, alternative.T_track_camera
    was_carried_along = _goes_on_from_alternative(T, last, problem.predicted)
    return SettledPose(pose, alternative, T @ se3.inverse(T_other) if was_carried_along else None)


def preferred(
    problem: PoseProblem, alternative: Alternative, pose: Refinement, acceptance: Acceptance
) -> PoseEstimate:
    """The alternative, refined without what agrees with the other pose alone.

    That would pull it back where the two are near.

    Args:
        problem: the frame, and what its pose is refined by.
        alternative: to ``pose``.
        pose: the one that was believed.
        acceptance: when a pose is plausible.
    """
    brightness = pose.affine_brightness
    kept = []
    for level in range(LEVELS):
        at = problem.at_level(level)
        own, other = alternative.T_track_camera, pose.T_model_source
        if level == 0:
            kept.append(agreeing_planes(at, own) | ~agreeing_planes(at, other))
        kept.append(agreeing_pixels(at, own, brightness) | ~agreeing_pixels(at, other, brightness))
    planes, *pixels = kept
    model = problem.model.selected(planes, pixels)
    of_the_rest = replace(problem, model=model)
    coarse = of_the_rest.refined(alternative.T_track_camera, COARSE_LEVELS, brightness)
    return of_the_rest.refined_further(coarse, acceptance)


def doubt(
    pose: Refinement, alternative: Alternative | None, spread: Float64, acceptance: Acceptance
) -> Float64:
    """What contradiction adds to the covariance of a pose, float64 [6, 6].

    Where there is an alternative it is the second moment of the two poses, each as likely as its
    share, about the one that is believed. Where planes contradict without agreeing on anything,
    and pixels alone speak for the pose, the camera is as likely anywhere that it can be.

    Args:
        pose: the one that is believed.
        alternative: to it, if there is one.
        spread: float64 [6, 6] of where the camera can be, perturbation on the right.
        acceptance: how many planes count as a contradiction.

    Returns:
        Perturbation on the left, in the track frame.
    """
    T = pose.T_model_source
    if alternative is not None:
        apart = se3.log(alternative.T_track_camera @ se3.inverse(T))
        return np.asarray(alternative.share * np.outer(apart, apart), np.float64)
    agreeing = pose.visible_agreement
    if pose.planes_visible < acceptance.min_planes or agreeing >= acceptance.plane_agreement:
        return np.zeros((6, 6))
    return np.asarray((1 - agreeing) * se3.transported_covariance(T, spread), np.float64)


def _goes_on_from_alternative(
    T_track_camera: Float64, last: LastPose, predicted: PredictedMotion
) -> bool:
    """Whether a pose goes on where the last alternative was, and not where the last pose was.

    Then tracking had been carried along by something that moves.
    """
    if last.alternative is None or predicted.expects(T_track_camera):
        return False
    T_shift = last.alternative.T_track_camera @ se3.inverse(last.motion.T_track_camera)
    return predicted.shifted(T_shift).expects(T_track_camera)
