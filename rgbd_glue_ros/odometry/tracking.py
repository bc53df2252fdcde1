"""Tracks a frame against the nearest keyframes: two starts, and the one that fits better."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Future
from dataclasses import dataclass

import numpy as np

from rgbd_glue_ros.features.geometric import TransformPrior
from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.odometry.acceptance import is_conclusive, is_plausible
from rgbd_glue_ros.odometry.background import BackgroundThread
from rgbd_glue_ros.odometry.keyframes import Keyframe
from rgbd_glue_ros.odometry.motion_filter import Motion
from rgbd_glue_ros.odometry.pose_refinement import (
    SELECTION_LEVELS,
    PoseEstimate,
    PoseProblem,
    fits_better,
    matches_prefer,
    refine_to_final_level,
)
from rgbd_glue_ros.parameters import OdometryConfig
from rgbd_glue_ros.refinement.gauss_newton import Refinement
from rgbd_glue_ros.refinement.model import Model
from rgbd_glue_ros.registration.glue import FrameFeatures, Glue
from rgbd_glue_ros.stopwatch import timed
from rgbd_glue_ros.types import (
    Correspondences,
    Float64,
    RegistrationResult,
    RegistrationStatus,
)


@dataclass(frozen=True)
class PoseFix:
    """A pose that is believed, and what it was found from.

    Attributes:
        estimate: the pose.
        reference: the keyframe that the frame was registered against.
        model: what the pose was refined against, in the track frame.
    """

    estimate: PoseEstimate
    reference: Keyframe
    model: Model


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


@dataclass(frozen=True)
class _PriorRefinement:
    """The predicted pose, refined on the background thread; each with the milliseconds it took."""

    selected: Future[tuple[Refinement, float]]
    final: Future[tuple[PoseEstimate, float]]


def track(
    problem: PoseProblem,
    references: Sequence[Keyframe],
    last: Motion,
    glue: Glue,
    background: BackgroundThread,
    config: OdometryConfig,
) -> Attempt:
    """Registers a frame against the nearest keyframe and refines its pose against the nearest few.

    Args:
        problem: the frame, its predicted motion, and the model of the nearest few keyframes.
        references: these keyframes, the nearest first.
        last: the motion at the last frame with a pose.
        glue: registers.
        background: refines the predicted pose while the frame is registered.
        config: when a pose is believed.
    """
    nearest = references[0]
    prior, prior_refinement = None, None
    if config.prior_radius > 0:
        T_nearest_camera = se3.inverse(nearest.T_track_camera) @ problem.predicted.T_track_camera
        prior = TransformPrior(T_nearest_camera, config.prior_radius)
        prior_refinement = _start_prior_refinement(problem, background, config)
    features = glue.extract(problem.view)
    registration = glue.register(features, nearest.features, prior)
    matches = registration.visual.moved_target(nearest.T_track_camera)
    T_registered = _registered_pose(registration, nearest)
    estimate, ms = _best_of_prior_and_registration(
        problem, prior_refinement, T_registered, matches, glue.inlier_threshold, config
    )
    registration = registration.with_stage("refinement", ms)
    if estimate is None:
        return Attempt(features, registration)
    if not _is_believed(estimate.refinement, last, problem.predicted, config):
        refused = registration.refused(RegistrationStatus.INCONSISTENT)
        return Attempt(features, refused)
    return Attempt(features, registration, PoseFix(estimate, nearest, problem.model))


def _start_prior_refinement(
    problem: PoseProblem, background: BackgroundThread, config: OdometryConfig
) -> _PriorRefinement:
    """Starts to refine the predicted pose; in most frames it ends where the registration does."""
    T = problem.predicted.T_track_camera
    selected, final = background.submit_stages(
        lambda: timed(problem.refined, T, SELECTION_LEVELS),
        lambda result: timed(refine_to_final_level, result[0], problem, config),
    )
    return _PriorRefinement(selected, final)


def _registered_pose(registration: RegistrationResult, reference: Keyframe) -> Float64 | None:
    """T_track_camera by the registration against a keyframe, None where that failed."""
    if registration.T_target_source is None:
        return None
    return reference.T_track_camera @ registration.T_target_source


def _best_of_prior_and_registration(
    problem: PoseProblem,
    prior_refinement: _PriorRefinement | None,
    T_registered: Float64 | None,
    matches: Correspondences,
    inlier_threshold: float,
    config: OdometryConfig,
) -> tuple[PoseEstimate | None, float]:
    """The pose refined from the prediction, or from the registration where that fits better.

    Waits for the background thread.

    Args:
        problem: the frame and the model.
        prior_refinement: of the predicted pose; None where there is none.
        T_registered: T_track_camera by the registration, float64 [4, 4], if there is one.
        matches: the visual matches, their targets in the track frame.
        inlier_threshold: distance within which a match agrees with a pose, metres.
        config: how far apart two starts are.

    Returns:
        It, None where there was neither start, and the milliseconds that its refinement took.
    """
    from_prior, prior_ms = None, 0.0
    if prior_refinement is not None:
        from_prior, prior_ms = prior_refinement.selected.result()
    if T_registered is not None and (
        from_prior is None or _is_far(T_registered, from_prior.T_model_source, config)
    ):
        registered, selection_ms = timed(problem.refined, T_registered, SELECTION_LEVELS)
        if (
            from_prior is None
            or fits_better(registered, from_prior)
            or matches_prefer(registered, from_prior, matches, inlier_threshold)
        ):
            estimate, final_ms = timed(refine_to_final_level, registered, problem, config)
            return estimate, selection_ms + final_ms
    if prior_refinement is None:
        return None, 0.0
    estimate, final_ms = prior_refinement.final.result()
    return estimate, prior_ms + final_ms


def _is_far(T_a: Float64, T_b: Float64, config: OdometryConfig) -> bool:
    """Whether two poses are so far apart that one refinement may not get from one to the other."""
    T = se3.inverse(T_b) @ T_a
    return bool(
        np.linalg.norm(T[:3, 3]) > config.surprise_translation
        or se3.rotation_angle(T) > config.surprise_rotation
    )


def _is_believed(
    refinement: Refinement, last: Motion, predicted: Motion, config: OdometryConfig
) -> bool:
    """Whether a pose is plausible, and within reach of the camera or beyond doubt."""
    if not is_plausible(refinement, refinement.planes_visible, config):
        return False
    return last.reaches(refinement.T_model_source, predicted) or is_conclusive(refinement, config)
