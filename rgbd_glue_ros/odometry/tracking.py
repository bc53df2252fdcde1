"""Tracks a frame against the nearest keyframes: two starts, and the one with more evidence."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from rgbd_glue_ros.features.geometric import TransformPrior
from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.geometry.fitting import distances
from rgbd_glue_ros.odometry.background import BackgroundThread
from rgbd_glue_ros.odometry.keyframes import Keyframe
from rgbd_glue_ros.odometry.motion_filter import Motion
from rgbd_glue_ros.odometry.pose_choice import Candidate, choose
from rgbd_glue_ros.odometry.pose_refinement import COARSE_LEVELS, PoseEstimate, PoseProblem
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
    nearest, predicted = references[0], problem.predicted
    prior, from_prior = None, None
    if config.prior_radius > 0:
        T_nearest_camera = se3.inverse(nearest.T_track_camera) @ predicted.T_track_camera
        prior = TransformPrior(T_nearest_camera, config.prior_radius)
        from_prior = background.submit(_candidate, predicted.T_track_camera, problem, last, config)
    features = glue.extract(problem.view)
    registration = glue.register(features, nearest.features, prior)
    candidates = [] if from_prior is None else [from_prior.result()]
    matches = registration.visual.moved_target(nearest.T_track_camera)
    T_registered = _registered_pose(registration, nearest)
    # in most frames both starts end at the same pose
    if T_registered is not None and not any(
        _is_near(c.coarse.T_model_source, T_registered, config) for c in candidates
    ):
        registered = _candidate(T_registered, problem, last, config)
        candidates.append(registered)
        inliers = registration.visual_inliers.moved_target(nearest.T_track_camera)
        if _leaves_behind(inliers, registered, T_registered, glue.inlier_threshold):
            held = replace(problem, matches=inliers)
            candidates.append(_candidate(T_registered, held, last, config))
    if not candidates:
        return Attempt(features, registration)
    chosen = choose(candidates, matches, glue.inlier_threshold, config)
    if chosen is None:
        return Attempt(features, registration.refused(RegistrationStatus.INCONSISTENT))
    registration = registration.with_stage("refinement", chosen.milliseconds)
    return Attempt(features, registration, PoseFix(chosen.estimate, nearest, problem.model))


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


def _is_near(T_a: Float64, T_b: Float64, config: OdometryConfig) -> bool:
    """Whether two poses are so near that refinement gets from one to the other."""
    T = se3.inverse(T_b) @ T_a
    return bool(
        np.linalg.norm(T[:3, 3]) <= config.surprise_translation
        and se3.rotation_angle(T) <= config.surprise_rotation
    )
