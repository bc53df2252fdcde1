"""Tracks a frame against the nearest keyframes: a few starts, and the one with most evidence."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Future
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.geometry.fitting import distances
from rgbd_glue_ros.odometry.acceptance import Acceptance
from rgbd_glue_ros.odometry.alternative import Alternative
from rgbd_glue_ros.odometry.background import BackgroundThread
from rgbd_glue_ros.odometry.contradiction import settle_contradiction
from rgbd_glue_ros.odometry.image_turn import turn_between
from rgbd_glue_ros.odometry.keyframes import Keyframe
from rgbd_glue_ros.odometry.motion_filter import PredictedMotion
from rgbd_glue_ros.odometry.pose_choice import CLEARLY_BETTER, Candidate, choose, fit, is_clear
from rgbd_glue_ros.odometry.pose_refinement import (
    COARSE_LEVELS,
    FINAL_LEVEL,
    PoseEstimate,
    PoseProblem,
)
from rgbd_glue_ros.odometry.progress import LastPose
from rgbd_glue_ros.odometry.unmeasured_direction import expected_where_unmeasured
from rgbd_glue_ros.refinement.gauss_newton import Refinement, evaluate_pose
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
    stages,
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

    @property
    def stages_ms(self) -> dict[str, float]:
        """The duration of each stage, milliseconds."""
        return {**self.features.stages_ms, **self.registration.stages_ms}


def track(
    problem: PoseProblem,
    nearest: Keyframe,
    last: LastPose,
    glue: Glue,
    background: BackgroundThread,
    acceptance: Acceptance,
    prior_radius: float,
) -> Attempt:
    """Registers a frame against the nearest keyframe and refines its pose against the nearest few.

    Args:
        problem: the frame, its predicted motion, and the model of the nearest few keyframes.
        nearest: the first of these.
        last: the last frame with a pose.
        glue: registers.
        background: refines the predicted pose while the frame is registered.
        acceptance: the evidence that a pose needs.
        prior_radius: how far the frame may be from its prediction if visual matches give no
            transform, metres; 0 does without the prediction.
    """
    uses_prior = prior_radius > 0
    from_prior = background.submit(_from_prior, problem, acceptance) if uses_prior else None
    features = glue.extract(problem.view)
    prior = _prior(problem.predicted, nearest, prior_radius) if uses_prior else None
    result = glue.register(features, nearest.features, prior)
    registration = _Registration(result, nearest, glue.inlier_threshold)
    candidates = _candidates(problem, from_prior, registration, last, acceptance)
    if not candidates:
        return Attempt(features, result)
    result = result.with_stage(stages.REFINEMENT, sum(c.milliseconds for c in candidates))
    choice = registration.matches, registration.inlier_threshold, acceptance
    chosen = choose(candidates, *choice) or choose(_where_expected(candidates, problem), *choice)
    if chosen is None:
        return Attempt(features, result.refused(RegistrationStatus.INCONSISTENT))
    settled = settle_contradiction(chosen, problem, last, acceptance)
    estimate = expected_where_unmeasured(settled.estimate, problem)
    fix = PoseFix(estimate, nearest, problem.model, settled.alternative, settled.T_shift)
    return Attempt(features, result, fix)


def turned_candidates(
    problem: PoseProblem, last: LastPose, acceptance: Acceptance
) -> list[Candidate]:
    """Poses refined from the whole image's rotation, at the last and at the predicted position.

    Phase correlation returns a rotation for any two images, so planes and pixels must both
    confirm it.

    Args:
        problem: the frame, and what its pose is refined by.
        last: the last frame with a pose.
        acceptance: when a pose is conclusive.
    """
    T_last, T_predicted = last.motion.T_track_camera, problem.predicted.T_track_camera
    R = T_last[:3, :3] @ turn_between(last.view, problem.view)
    turned = [
        _candidate(se3.from_rotation_translation(R, T[:3, 3]), problem, acceptance)
        for T in (T_predicted, T_last)
    ]
    return [candidate for candidate in turned if acceptance.is_conclusive(candidate.refinement)]


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


def _from_prior(problem: PoseProblem, acceptance: Acceptance) -> Candidate:
    """The pose that the predicted one leads to."""
    return _candidate(problem.predicted.T_track_camera, problem, acceptance)


def _prior(predicted: PredictedMotion, keyframe: Keyframe, radius: float) -> TransformPrior:
    """Where to search for the transform to a keyframe: around the predicted pose."""
    T_keyframe_camera = se3.inverse(keyframe.T_track_camera) @ predicted.T_track_camera
    return TransformPrior(T_keyframe_camera, radius)


def _candidates(
    problem: PoseProblem,
    from_prior: Future[Candidate] | None,
    registration: _Registration,
    last: LastPose,
    acceptance: Acceptance,
) -> list[Candidate]:
    """The poses that different starts lead to: as few as make one of them clear."""
    candidates = [] if from_prior is None else [from_prior.result()]
    candidates += _registered_candidates(problem, registration, candidates, acceptance)
    matches, threshold = registration.matches, registration.inlier_threshold
    if candidates and not any(is_clear(c, matches, threshold, acceptance) for c in candidates):
        candidates += turned_candidates(problem, last, acceptance)
    return candidates


def _where_expected(candidates: Sequence[Candidate], problem: PoseProblem) -> list[Candidate]:
    """Candidates out of the camera's reach, put back where that is for want of a measurement.

    Without texture a corridor's walls carry a pose along it by half a metre, which is farther than
    a camera gets between two frames.
    """
    put_back = []
    for candidate in candidates:
        estimate = expected_where_unmeasured(candidate.estimate, problem)
        distance_squared = problem.predicted.distance_squared(estimate.T_track_camera)
        put_back.append(replace(candidate, estimate=estimate, distance_squared=distance_squared))
    return put_back


def _registered_candidates(
    problem: PoseProblem,
    registration: _Registration,
    others: Sequence[Candidate],
    acceptance: Acceptance,
) -> list[Candidate]:
    """The poses refined from the registered transform.

    Empty if refinement from another start already got there, as in most frames. If refinement
    abandons the visual inliers, a second pose is held by them.
    """
    T_registered = registration.T_track_camera
    if T_registered is None or any(
        problem.basin.connects(other.coarse.T_model_source, T_registered) for other in others
    ):
        return []
    registered = _candidate(T_registered, problem, acceptance)
    inliers = registration.inliers
    if not _leaves_behind(inliers, registered, T_registered, registration.inlier_threshold):
        return [registered]
    held = replace(problem, matches=inliers)
    return [registered, _candidate(T_registered, held, acceptance)]


def _candidate(T_track_camera: Float64, problem: PoseProblem, acceptance: Acceptance) -> Candidate:
    """The pose that refinement ends at from a start."""
    (estimate, coarse), ms = timed(_refined, T_track_camera, problem, acceptance)
    distance_squared = problem.predicted.distance_squared(estimate.T_track_camera)
    return Candidate(estimate, coarse, distance_squared, ms)


def _refined(
    T_track_camera: Float64, problem: PoseProblem, acceptance: Acceptance
) -> tuple[PoseEstimate, Refinement]:
    """The pose that refinement ends at from a start, and the pose after the coarse levels alone.

    Along a corridor planes agree anywhere, but for errors of their normals. Those carry a pose away
    at the coarse levels if too few pixels there hold it. So if it goes far, it is also refined
    without these levels.
    """
    coarse = problem.refined(T_track_camera, COARSE_LEVELS)
    estimate = problem.refined_further(coarse, acceptance)
    if problem.basin.connects(T_track_camera, coarse.T_model_source):
        return estimate, coarse
    near = problem.refined(T_track_camera, [FINAL_LEVEL])
    is_better = (
        acceptance.is_plausible(near, near.planes_visible)
        and 2 * near.pixels_seen >= acceptance.min_pixels
        and fit(near) > fit(estimate.refinement) + CLEARLY_BETTER
    )
    if not is_better:
        return estimate, coarse
    T_near = near.T_model_source
    return PoseEstimate(near), evaluate_pose(T_near, problem, COARSE_LEVELS[-1])


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
