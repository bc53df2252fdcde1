"""Tracks a frame against the nearest keyframes: a few starts, and the one with most evidence."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Future
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.geometry.fitting import distances
from rgbd_glue_ros.odometry.acceptance import is_conclusive
from rgbd_glue_ros.odometry.alternative import Alternative
from rgbd_glue_ros.odometry.background import BackgroundThread
from rgbd_glue_ros.odometry.contradiction import settle_contradiction
from rgbd_glue_ros.odometry.image_turn import turn_between
from rgbd_glue_ros.odometry.keyframes import Keyframe
from rgbd_glue_ros.odometry.motion_filter import PredictedMotion
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
from rgbd_glue_ros.registration.frame_features import FrameFeatures
from rgbd_glue_ros.registration.glue import Glue
from rgbd_glue_ros.stopwatch import timed
from rgbd_glue_ros.types import (
    Correspondences,
    Float64,
    RegistrationResult,
    RegistrationStatus,
    TransformPrior,
)


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
    nearest = references[0]
    from_prior = _start_prior_refinement(problem, background, config)
    features = glue.extract(problem.view)
    registration = _register(features, nearest, problem.predicted, glue, config)
    candidates = _candidates(problem, from_prior, registration, last, config)
    if not candidates:
        return Attempt(features, registration.result)
    chosen = choose(candidates, registration.matches, registration.inlier_threshold, config)
    if chosen is None:
        inconsistent = registration.result.refused(RegistrationStatus.INCONSISTENT)
        return Attempt(features, inconsistent)
    settled = settle_contradiction(chosen, problem, last, config)
    estimate = problem.reliable(settled.estimate, config)
    fix = PoseFix(estimate, nearest, problem.model, settled.alternative, settled.T_shift)
    result = registration.result.with_stage("refinement", chosen.milliseconds)
    return Attempt(features, result, fix)


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
        _candidate(se3.from_rotation_translation(R, T[:3, 3]), problem, config)
        for T in (T_predicted, T_last)
    ]
    return [candidate for candidate in turned if is_conclusive(candidate.refinement, config)]


@dataclass(frozen=True)
class _Registration:
    """The registration of a frame against a keyframe, as it is in the track frame.

    Attributes:
        result: against the keyframe.
        keyframe: which.
        inlier_threshold: distance within which a match agrees with a pose, metres.
    """

    result: RegistrationResult
    keyframe: Keyframe
    inlier_threshold: float

    @property
    def T_track_camera(self) -> Float64 | None:
        """The pose of the frame, float64 [4, 4]; None where there is no transform."""
        if self.result.T_target_source is None:
            return None
        return self.keyframe.T_track_camera @ self.result.T_target_source

    @cached_property
    def matches(self) -> Correspondences:
        """All visual matches, their targets in the track frame."""
        return self.result.visual.moved_target(self.keyframe.T_track_camera)

    @cached_property
    def inliers(self) -> Correspondences:
        """Those that the transform rests on."""
        return self.result.visual_inliers.moved_target(self.keyframe.T_track_camera)


def _start_prior_refinement(
    problem: PoseProblem, background: BackgroundThread, config: OdometryConfig
) -> Future[Candidate] | None:
    """Starts to refine the predicted pose; None where no prediction is to be used."""
    if config.prior_radius <= 0:
        return None
    T_predicted = problem.predicted.T_track_camera
    return background.submit(_candidate, T_predicted, problem, config)


def _register(
    features: FrameFeatures,
    keyframe: Keyframe,
    predicted: PredictedMotion,
    glue: Glue,
    config: OdometryConfig,
) -> _Registration:
    """Registers a frame against a keyframe, around the predicted pose where one is to be used."""
    prior = None
    if config.prior_radius > 0:
        T_keyframe_camera = se3.inverse(keyframe.T_track_camera) @ predicted.T_track_camera
        prior = TransformPrior(T_keyframe_camera, config.prior_radius)
    result = glue.register(features, keyframe.features, prior)
    return _Registration(result, keyframe, glue.inlier_threshold)


def _candidates(
    problem: PoseProblem,
    from_prior: Future[Candidate] | None,
    registration: _Registration,
    last: LastPose,
    config: OdometryConfig,
) -> list[Candidate]:
    """The poses that different starts lead to: as few as make one of them clear."""
    candidates = [] if from_prior is None else [from_prior.result()]
    candidates += _registered_candidates(problem, registration, candidates, config)
    matches, threshold = registration.matches, registration.inlier_threshold
    if candidates and not any(is_clear(c, matches, threshold) for c in candidates):
        candidates += turned_candidates(problem, last, config)
    return candidates


def _registered_candidates(
    problem: PoseProblem,
    registration: _Registration,
    others: Sequence[Candidate],
    config: OdometryConfig,
) -> list[Candidate]:
    """The poses from where registration has the frame, without its inliers and with them.

    None where refinement got there from another start, as it does in most frames; that with the
    inliers only where refinement leaves them behind.
    """
    T_registered = registration.T_track_camera
    if T_registered is None or any(
        is_near(other.coarse.T_model_source, T_registered, config) for other in others
    ):
        return []
    registered = _candidate(T_registered, problem, config)
    inliers = registration.inliers
    if not _leaves_behind(inliers, registered, T_registered, registration.inlier_threshold):
        return [registered]
    held = replace(problem, matches=inliers)
    return [registered, _candidate(T_registered, held, config)]


def _candidate(T_track_camera: Float64, problem: PoseProblem, config: OdometryConfig) -> Candidate:
    """The pose that refinement ends at from a start."""
    coarse, coarse_ms = timed(problem.refined, T_track_camera, COARSE_LEVELS)
    estimate, further_ms = timed(problem.refined_further, coarse, config)
    distance_squared = problem.predicted.distance_squared(estimate.T_track_camera)
    return Candidate(estimate, coarse, distance_squared, coarse_ms + further_ms)


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
