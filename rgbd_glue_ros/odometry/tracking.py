"""Tracks a frame against the nearest keyframes: a few starts, and the one with most evidence."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from rgbd_glue_ros.features.geometric import TransformPrior
from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.geometry.fitting import distances
from rgbd_glue_ros.odometry.acceptance import is_conclusive, is_plausible
from rgbd_glue_ros.odometry.background import BackgroundThread
from rgbd_glue_ros.odometry.contradiction import (
    Alternative,
    find_alternative,
    is_contradicted,
    preferred,
)
from rgbd_glue_ros.odometry.image_turn import turn_between
from rgbd_glue_ros.odometry.keyframes import Keyframe
from rgbd_glue_ros.odometry.motion_filter import Motion
from rgbd_glue_ros.odometry.pose_choice import Candidate, choose, is_clear
from rgbd_glue_ros.odometry.pose_refinement import (
    COARSE_LEVELS,
    PoseEstimate,
    PoseProblem,
    is_near,
)
from rgbd_glue_ros.odometry.progress import LastPose
from rgbd_glue_ros.parameters import OdometryConfig
from rgbd_glue_ros.refinement.model import Model
from rgbd_glue_ros.registration.glue import FrameFeatures, Glue
from rgbd_glue_ros.stopwatch import timed
from rgbd_glue_ros.types import Correspondences, Float64, RegistrationResult, RegistrationStatus


@dataclass(frozen=True)
class PoseFix:
    """A pose that is believed, and what it was found from.

    Attributes:
        estimate: the pose.
        reference: the keyframe that the frame was registered against.
        model: what the pose was refined against, in the track frame.
        alternative: what else the frame may show, if a part of it contradicts the pose.
        T_shift: float64 [4, 4], multiplied on the left of poses as tracked from this frame on,
            where those before turned out to be carried along; None in all other frames.
    """

    estimate: PoseEstimate
    reference: Keyframe
    model: Model
    alternative: Alternative | None = None
    T_shift: Float64 | None = None


@dataclass(frozen=True)
class Attempt:
    """What trying to find the pose of a frame gave.

    Attributes:
        features: of the frame.
        registration: that the pose rests on, or that says why there is none.
        fix: the pose; None if there is none.
    """

    features: FrameFeatures
    registration: RegistrationResult
    fix: PoseFix | None = None


def track(
    problem: PoseProblem,
    references: Sequence[Keyframe],
    last: LastPose,
    glue: Glue,
    background: BackgroundThread,
    config: OdometryConfig,
) -> Attempt:
    """Registers a frame against the nearest keyframe and refines its pose against the nearest few.

    Args:
        problem: the frame, its predicted motion, and the model of the nearest few keyframes.
        references: these keyframes, the nearest first.
        last: the last frame with a pose.
        glue: registers.
        background: refines the predicted pose while the frame is registered.
        config: when a pose is believed.
    """
    nearest, predicted, before = references[0], problem.predicted, last.motion
    prior, from_prior = None, None
    if config.prior_radius > 0:
        T_nearest_camera = se3.inverse(nearest.T_track_camera) @ predicted.T_track_camera
        prior = TransformPrior(T_nearest_camera, config.prior_radius)
        from_prior = background.submit(
            _candidate, predicted.T_track_camera, problem, before, config
        )
    features = glue.extract(problem.view)
    registration = glue.register(features, nearest.features, prior)
    candidates = [] if from_prior is None else [from_prior.result()]
    matches = registration.visual.moved_target(nearest.T_track_camera)
    T_registered = _registered_pose(registration, nearest)
    # in most frames both starts end at the same pose
    if T_registered is not None and not any(
        is_near(c.coarse.T_model_source, T_registered, config) for c in candidates
    ):
        registered = _candidate(T_registered, problem, before, config)
        candidates.append(registered)
        inliers = registration.visual_inliers.moved_target(nearest.T_track_camera)
        if _leaves_behind(inliers, registered, T_registered, glue.inlier_threshold):
            held = replace(problem, matches=inliers)
            candidates.append(_candidate(T_registered, held, before, config))
    if candidates and not any(is_clear(c, matches, glue.inlier_threshold) for c in candidates):
        candidates += turned_candidates(problem, last, config)
    if not candidates:
        return Attempt(features, registration)
    chosen = choose(candidates, matches, glue.inlier_threshold, config)
    if chosen is None:
        return Attempt(features, registration.refused(RegistrationStatus.INCONSISTENT))
    registration = registration.with_stage("refinement", chosen.milliseconds)
    fix = PoseFix(chosen.estimate, nearest, problem.model)
    weighed = _weighed(fix, chosen, last, problem, config)
    reliable = replace(weighed, estimate=problem.reliable(weighed.estimate, config))
    return Attempt(features, registration, reliable)


def turned_candidates(
    problem: PoseProblem, last: LastPose, config: OdometryConfig
) -> list[Candidate]:
    """Poses from where the whole image has turned to: without a way, and with the expected one.

    Any two images are laid over each other somehow, so that planes and pixels have to bear it out.

    Args:
        problem: the frame, and what its pose is refined by.
        last: the last frame with a pose.
        config: when a pose is believed.
    """
    T_last, T_predicted = last.motion.T_track_camera, problem.predicted.T_track_camera
    R = T_last[:3, :3] @ turn_between(last.view, problem.view)
    turned = [
        _candidate(se3.from_rotation_translation(R, T[:3, 3]), problem, last.motion, config)
        for T in (T_predicted, T_last)
    ]
    return [candidate for candidate in turned if is_conclusive(candidate.refinement, config)]


def _weighed(
    fix: PoseFix,
    chosen: Candidate,
    last: LastPose,
    problem: PoseProblem,
    config: OdometryConfig,
) -> PoseFix:
    """A pose and what contradicts it; the other way round where more speaks for that.

    That are the larger surface and one more witness: the frame before, or the camera's motion.

    Args:
        fix: the pose.
        chosen: the same among the candidates.
        last: the last frame with a pose; its alternative, if that was contradicted too.
        problem: the frame, and what its pose was refined by.
        config: when a pose is believed.
    """
    before = last.alternative
    # what the finest level resolves was none
    if not is_contradicted(chosen.refinement):
        return fix
    alternative = find_alternative(problem, chosen.coarse, before, config)
    if alternative is None:
        return fix
    pose, predicted = fix.estimate, problem.predicted
    is_likelier = last.motion.surprise(alternative.T_track_camera, predicted) < chosen.surprise
    if alternative.is_larger and (before is not None or is_likelier):
        larger = preferred(problem, alternative, chosen.coarse, config)
        if is_plausible(larger.refinement, larger.refinement.planes_visible, config):
            alternative = Alternative(pose.T_track_camera, 1 - alternative.share)
            pose = larger
    T, T_other = pose.T_track_camera, alternative.T_track_camera
    # the pose goes on where the alternative was, and not where the pose was
    was_carried_along = (
        before is not None
        and not predicted.expects(T)
        and predicted.shifted(
            before.T_track_camera @ se3.inverse(last.motion.T_track_camera)
        ).expects(T)
    )
    T_shift = T @ se3.inverse(T_other) if was_carried_along else None
    return replace(fix, estimate=pose, alternative=alternative, T_shift=T_shift)


def _candidate(
    T_track_camera: Float64, problem: PoseProblem, last: Motion, config: OdometryConfig
) -> Candidate:
    """The pose that refinement ends at from a start."""
    coarse, coarse_ms = timed(problem.refined, T_track_camera, COARSE_LEVELS)
    estimate, further_ms = timed(problem.refined_further, coarse, config)
    surprise = last.surprise(estimate.T_track_camera, problem.predicted)
    return Candidate(estimate, coarse, surprise, coarse_ms + further_ms)


def _registered_pose(registration: RegistrationResult, reference: Keyframe) -> Float64 | None:
    """T_track_camera by the registration against a keyframe, None where that failed."""
    if registration.T_target_source is None:
        return None
    return reference.T_track_camera @ registration.T_target_source


def _leaves_behind(
    inliers: Correspondences, candidate: Candidate, T_registered: Float64, inlier_threshold: float
) -> bool:
    """Whether refinement has lost most of the visual inliers that it started from.

    Planes slide along themselves where there is little else.
    """
    before, after = (
        np.count_nonzero(distances(T, inliers) <= inlier_threshold)
        for T in (T_registered, candidate.estimate.T_track_camera)
    )
    return bool(2 * after < before)
